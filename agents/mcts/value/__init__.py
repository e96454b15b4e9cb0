"""Value bootstrapping: a small network that estimates the return beyond the end of a walk."""
