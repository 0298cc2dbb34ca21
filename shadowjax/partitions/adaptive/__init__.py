"""Adaptive shadow maps: tiles refined where the view needs them."""
