"""How the texels of a map are spread over a light's plane."""
