"""GHRL: learned sub-policies and a master over them, answer-set rules, and RSS, which decides when rules drive."""
