"""GHRL: learned sub-policies and a master over them, answer-set rules, and RSS that says when rules alone drive."""
