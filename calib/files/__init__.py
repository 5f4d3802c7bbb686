"""The only place with millimetres, degrees, TOML, CSV and XML."""
