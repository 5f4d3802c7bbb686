"""What a person sees of a diagnosis: tables and figures."""
