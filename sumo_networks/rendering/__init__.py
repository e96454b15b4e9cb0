"""How a network and its traffic look: what the bird's-eye view and the cameras draw with."""
