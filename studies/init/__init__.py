"""A first cell of the user's own robot."""

from studies.init.cell_text import cell_text, table_header

__all__ = ["cell_text", "table_header"]
