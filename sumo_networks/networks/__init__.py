"""Road networks: the arrays of a network, the catalog of names, import, inspection, projection and drawing."""
