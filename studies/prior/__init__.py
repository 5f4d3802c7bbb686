"""What a type of robot knows, learnt from a fleet by ``posecal fleet --prior``."""
