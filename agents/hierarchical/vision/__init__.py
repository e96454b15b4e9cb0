"""Vision: an autoencoder of semantic images, whose latent vector is what GHRL's policies see of the others."""
