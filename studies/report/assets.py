"""Style sheets and scripts of the page, as they stand beside this file."""

from __future__ import annotations

from importlib.resources import files

from markupsafe import Markup


def asset(name: str) -> Markup:
    """The text of a file, to stand inside ``<style>`` or ``<script>``."""
    return Markup((files("studies.report") / name).read_text(encoding="utf-8"))  # noqa: S704
