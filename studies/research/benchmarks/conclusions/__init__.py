"""How often the conclusions of ``posecal diagnose`` come true, by a truth that shares no code with it.

    python -m studies.research.benchmarks.conclusions [PART ...] [--days N] [--seed S] [--workers W]
        [--json FILE]

A day is an arm in MuJoCo that errs by formulas of this package, and files as a user would bring them.
What is said of it is the JSON of the diagnosis; nothing else is judged.

arm_a : a UR-like arm on a track, two causes, and its ordinary repeatability that no cell states
nothing, loud : no cause at all; the arm scatters by .5 to 3 times the instrument, or by ten times what
    its data sheet says
foreign : one cause of the catalogue by another formula
hard : kinds that are missed or misnamed more often than others, families of joints, and pairs
outside : one cause that no catalogue holds

``right``: the effect has the name of a true cause, at its place (and its cycles or its moment).
``in class``: the true one is among the few that the effect says it cannot be told from. ``wrong``: any
other.
The noncentrality is the squared length of what a cause displaces, whitened by the noise of instrument
and arm, after base, markers and geometry have taken up what they can. Of an error of
all joints it is that of all together; at least two members are visible: above 60 beside the others.
"""
