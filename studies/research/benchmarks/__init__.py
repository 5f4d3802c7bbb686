"""Comparisons with other programs, each run as a module; nothing else imports them."""
