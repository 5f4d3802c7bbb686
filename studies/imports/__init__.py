"""What ``posecal import`` shows of the files that it joined."""
