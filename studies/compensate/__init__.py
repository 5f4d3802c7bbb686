"""What ``posecal compensate`` says."""
