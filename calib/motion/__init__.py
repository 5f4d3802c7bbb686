"""Joint torques of motions: which terms the model lacks, by runs that are left out."""
