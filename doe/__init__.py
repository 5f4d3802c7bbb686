"""doe: which poses to measure, and a proof of how good they are."""
