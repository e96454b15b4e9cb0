"""A-VIS: GRIAD's visual encoder, two networks on three cameras, trained once and then frozen."""
