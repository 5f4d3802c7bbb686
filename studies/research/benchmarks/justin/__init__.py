"""DLR's humanoid Agile Justin: identified beside what is published, and days planned for it."""
