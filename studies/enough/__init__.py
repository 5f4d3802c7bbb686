"""What ``posecal enough`` shows."""
