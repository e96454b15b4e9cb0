"""RLAD: reinforcement learning from pixels with one encoder, A-LIX, WayConv1D and a loss of traffic lights."""
