"""`ispom grade` and `ispom new-method`: a method of a student, from its skeleton to its points."""
