"""Shadow techniques: each is built for a mesh, a light and a camera, then gives visibility."""
