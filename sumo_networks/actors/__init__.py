"""What moves around the egos: its names, the actors that scripts move, and the requests that SUMO carries out."""
