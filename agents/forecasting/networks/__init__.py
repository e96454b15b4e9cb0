"""Networks: trunks that read a history, ways to look ahead, and a registry."""
