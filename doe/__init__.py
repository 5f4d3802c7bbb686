"""doe: which poses to measure."""
