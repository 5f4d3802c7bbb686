"""The paper's own cases, computed again."""
