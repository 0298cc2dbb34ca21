"""Polygons before a light: their order by a BSP tree."""
