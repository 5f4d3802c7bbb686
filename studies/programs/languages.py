"""Robot programs that drive a plan: one file a language, one entry here."""

from studies.programs.fanuc import fanuc
from studies.programs.krl import krl
from studies.programs.rapid import rapid
from studies.programs.stops import Language, Program, Stop, checked_lines, plan_stops
from studies.programs.urscript import urscript

LANGUAGES: dict[str, Language] = {
    ".src": krl,
    ".script": urscript,
    ".mod": rapid,
    ".ls": fanuc,
}
"""The function that writes a program, by the ending of its file."""

__all__ = ["LANGUAGES", "Language", "Program", "Stop", "checked_lines", "plan_stops"]
