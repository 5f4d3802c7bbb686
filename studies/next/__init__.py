"""``posecal next``: the next poses after what was measured, or that it is time to stop."""
