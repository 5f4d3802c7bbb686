"""``posecal schema``: the JSON Schema of a result."""
