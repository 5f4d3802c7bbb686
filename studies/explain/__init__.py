"""``posecal explain``: topics, written once in ``topics`` or made from the package's own tables."""
