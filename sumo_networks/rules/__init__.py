"""Rules of geometry and right of way that criteria, rewards and sensors share."""
