"""Perception: what all pixel learners share: encoders, a VAE, augmentations, a cache of features, recording."""
