"""Meshes, cameras, lights and scenes."""
