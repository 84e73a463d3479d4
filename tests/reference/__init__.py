"""Independent reference solutions, against which the finite elements of the program are tested."""
