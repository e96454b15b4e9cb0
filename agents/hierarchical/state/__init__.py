"""What policies see: the exact state in numbers, and which part of it each policy gets."""
