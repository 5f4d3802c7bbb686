"""The line that each mistake of a person gets, and how often a healthy day is called a mistake."""
