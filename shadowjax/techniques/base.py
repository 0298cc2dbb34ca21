"""What a technique is: `build(mesh, light, camera)` gives shadows, which answer `visibility(points, normals)`."""

from abc import abstractmethod
from typing import ClassVar

from shadowjax._checked import Checked
from shadowjax._types import Array, Float, Int, Points
from shadowjax.geometry.camera import Camera
from shadowjax.geometry.light import Light
from shadowjax.geometry.mesh import Mesh


class Shadows(Checked):
    """What a technique has built for one light: it answers for any point."""

    @abstractmethod
    def visibility(self, points: Points, normals: Points) -> Float[Array, "*points"]:
        """Fraction of the light that reaches each point, in [0, 1]: 1 lit, 0 in shadow.

        Args:
            points: World points on surfaces.
            normals: Unit normals of the side that is looked at; one that does not face the light by
                more than rounding is dark.
        """

    def visibility_of(self, points: Points, normals: Points, faces: Int[Array, "*points"]) -> Float[Array, "*points"]:
        """As `visibility`, for points whose triangle is known; techniques that compare surfaces look at it.

        Args:
            points: World points on surfaces.
            normals: Unit normals of the side that is looked at.
            faces: Triangle that each point lies on; −1 for points on none.
        """
        del faces
        return self.visibility(points, normals)

    @property
    @abstractmethod
    def map_bytes(self) -> int:
        """Bytes of all stored planes."""

    def volume_bytes(self, num_samples: int) -> int:
        """Memory used instead of a shadow map: volume geometry plus a stencil buffer of `num_samples`."""
        del num_samples
        return 0

    @property
    def prefers_images(self) -> bool:
        """Whether `visibility` is faster for points of an image, (rows, cols, 3), than for a list of them."""
        return False


class Technique(Checked):
    """A way to answer "how much of the light arrives here?"."""

    _remedy_: ClassVar = "make_technique(name) makes one"

    @abstractmethod
    def build(self, mesh: Mesh, light: Light, camera: Camera) -> Shadows:
        """Do the work that does not depend on receivers."""

    @property
    @abstractmethod
    def num_tones(self) -> int | None:
        """Upper bound on distinct visibilities; None where they are a continuum."""
