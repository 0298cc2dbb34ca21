"""The names that `import shadowjax` offers, from where they live; loaded when the first of them is asked for."""

from shadowjax._types import astype
from shadowjax.bias.rule import Bias
from shadowjax.filters.brabec_seidel import PropagatedNeighbours, Supersampled
from shadowjax.filters.convolution import Convolution, FourierStep, MeanDepthConvolution
from shadowjax.filters.exponential import Exponential
from shadowjax.filters.exponential_variance import ExponentialVariance
from shadowjax.filters.hard import Hard
from shadowjax.filters.hierarchical_minimum import HierarchicalMinimum
from shadowjax.filters.moment import Moments
from shadowjax.filters.multi_depth import (
    FixedNeighbour,
    MultiDepth,
    Neighbourhood,
    Ring,
    StochasticNeighbour,
    composite_attenuation,
    max_neighbour,
    min_max_neighbours,
    min_neighbour,
    ring,
)
from shadowjax.filters.pcf import (
    BilinearPercentageCloser,
    PercentageCloser,
    bilinear_percentage_closer,
    percentage_closer,
)
from shadowjax.filters.pcss import ContactHardening
from shadowjax.filters.prefilter import Prefilter
from shadowjax.filters.variance import Variance
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import DirectionalLight, PointLight, SpotLight
from shadowjax.geometry.mesh import Mesh
from shadowjax.geometry.mesh_files import load
from shadowjax.geometry.outlines import MeshEdges, mesh_edges
from shadowjax.maps.shadow_map import ShadowMap, build_shadow_map
from shadowjax.partitions.cascades import Cascades
from shadowjax.partitions.cube import CubeMap
from shadowjax.partitions.faces import FacePartition
from shadowjax.partitions.registry import PARTITIONS, make_partition
from shadowjax.partitions.single import SingleMap
from shadowjax.rays.brute import BruteForceCaster
from shadowjax.rays.ray import Hit, Rays, intersect
from shadowjax.rays.ray_grid import RayGrid, camera_grid
from shadowjax.scenes import SCENES, Scene
from shadowjax.scenes import make as make_scene
from shadowjax.shading import Material, shade, trace_surface, visibility_on
from shadowjax.silhouettes.coverage import coverage_depth, coverage_planes
from shadowjax.silhouettes.shadow_picture import Receiver, plane_receiver, shadow_picture
from shadowjax.techniques.adaptive import AdaptiveShadowMapping
from shadowjax.techniques.exact import Exact
from shadowjax.techniques.jittered import JitteredLights
from shadowjax.techniques.registry import TECHNIQUES, make_technique
from shadowjax.techniques.shadow_mapping import ShadowMapping
from shadowjax.techniques.shadow_volumes import ShadowVolumes
from shadowjax.volumes.stencil import Stencil
from shadowjax.warps.fit import LogarithmicFit, PerspectiveFit
from shadowjax.warps.stable import StableFit
from shadowjax.warps.uniform import UniformFit

__all__ = [
    "PARTITIONS",
    "SCENES",
    "TECHNIQUES",
    "AdaptiveShadowMapping",
    "Bias",
    "BilinearPercentageCloser",
    "BruteForceCaster",
    "Camera",
    "Cascades",
    "ContactHardening",
    "Convolution",
    "CubeMap",
    "DirectionalLight",
    "Exact",
    "Exponential",
    "ExponentialVariance",
    "FacePartition",
    "FixedNeighbour",
    "FourierStep",
    "Hard",
    "HierarchicalMinimum",
    "Hit",
    "JitteredLights",
    "LogarithmicFit",
    "Material",
    "MeanDepthConvolution",
    "Mesh",
    "MeshEdges",
    "Moments",
    "MultiDepth",
    "Neighbourhood",
    "PercentageCloser",
    "PerspectiveFit",
    "PointLight",
    "Prefilter",
    "PropagatedNeighbours",
    "RayGrid",
    "Rays",
    "Receiver",
    "Ring",
    "Scene",
    "ShadowMap",
    "ShadowMapping",
    "ShadowVolumes",
    "SingleMap",
    "SpotLight",
    "StableFit",
    "Stencil",
    "StochasticNeighbour",
    "Supersampled",
    "UniformFit",
    "Variance",
    "astype",
    "bilinear_percentage_closer",
    "build_shadow_map",
    "camera_grid",
    "composite_attenuation",
    "coverage_depth",
    "coverage_planes",
    "intersect",
    "load",
    "make_partition",
    "make_scene",
    "make_technique",
    "max_neighbour",
    "mesh_edges",
    "min_max_neighbours",
    "min_neighbour",
    "percentage_closer",
    "plane_receiver",
    "ring",
    "shade",
    "shadow_picture",
    "trace_surface",
    "visibility_on",
]
