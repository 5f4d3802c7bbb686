"""What a person sees of an identification: tables and figures."""
