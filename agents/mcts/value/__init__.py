"""Value bootstrapping: a small network that says what a state is worth beyond the end of a walk."""
