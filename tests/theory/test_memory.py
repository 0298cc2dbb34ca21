"""Memory from formats: exact bytes, and all 36 cells of the source's table but the one that is wrong."""

import pytest

from shadowjax.theory.memory import (
    PRINTED_TABLE,
    SOURCE_STORAGE,
    Texture,
    convolution_textures,
    planes_in_formats,
    wrong_cells,
)


@pytest.mark.parametrize(
    ("name", "resolution", "expected"),
    [("pcf", 256, 349_524), ("vsm", 256, 699_048), ("csm", 256, 5_854_528), ("csm", 2048, 374_691_136)],
)
def test_exact_bytes(name, resolution, expected):
    assert SOURCE_STORAGE[name].num_bytes(resolution) == expected


def test_the_printed_table_is_reproduced_but_for_one_cell():
    assert sum(len(row) for row in PRINTED_TABLE.values()) == 36
    assert wrong_cells() == [(256, "csm C", 0.512, 0.256)]


def test_blur_needs_a_temporary_texture():
    assert SOURCE_STORAGE["esm"].num_bytes(256, blurred=True) - SOURCE_STORAGE["esm"].num_bytes(256) == 256 * 1024
    assert SOURCE_STORAGE["pcf"].num_bytes(256, blurred=True) == SOURCE_STORAGE["pcf"].num_bytes(256)


def test_planes_fill_textures_of_four():
    assert convolution_textures(16) == 8
    assert convolution_textures(1) == 1
    assert planes_in_formats(9) == (Texture("RGBA", 32, False, 2), Texture("R", 32, False))
    assert sum(texture.num_bytes(4) for texture in planes_in_formats(3)) == 16 * 16  # three take the room of four
    assert planes_in_formats(0) == ()
    assert Texture("R", 8).num_bytes(4) == 16 + 4 + 1
    assert Texture("R", 8).num_bytes(5) == 25 + 4 + 1


def test_bad_formats_are_named():
    with pytest.raises(ValueError, match="channels must be one of 'R', 'RG', 'RGBA'; got 'RGB'"):
        Texture("RGB", 8)
    with pytest.raises(ValueError, match="bits must be one of 8, 16, 32"):
        Texture("R", 24)
    with pytest.raises(ValueError, match="must not be negative"):
        planes_in_formats(-1)
