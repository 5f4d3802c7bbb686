"""``posecal init``: a first cell of the user's own robot."""
