"""What an identification is worth when poses are few."""
