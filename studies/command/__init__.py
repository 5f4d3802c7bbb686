"""What the commands share. Only click is imported before a command runs."""
