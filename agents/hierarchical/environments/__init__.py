"""Environments that policies learn in: exercises of one manoeuvre, and missions through town."""
