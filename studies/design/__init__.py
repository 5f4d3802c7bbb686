"""What a person sees of a design: tables and figures."""
