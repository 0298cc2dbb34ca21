"""Techniques compared with the reference: error, acne, seams, shimmer, gradients, memory and time."""
