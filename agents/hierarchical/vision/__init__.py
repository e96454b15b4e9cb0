"""Vision: an autoencoder of semantic images, whose latent vector describes the others for GHRL's policies."""
