"""After a diagnosis: the poses, or the interventions, that tell its rivals apart."""

from doe.prospect.rivals.next_poses import NextPoses

__all__ = ["NextPoses"]
