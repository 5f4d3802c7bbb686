"""``posecal demo``: the whole way on the paper's robot."""
