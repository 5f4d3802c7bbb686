"""Results: one frozen class a JSON object, one file a command; templates say them in words."""
