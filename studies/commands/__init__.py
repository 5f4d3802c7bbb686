"""The commands of ``posecal``: each reads, calls and writes."""
