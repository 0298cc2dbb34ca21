"""Makes the pictures of the site that take minutes: `python docs/pictures.py front | gallery | all`.

`front` writes docs/_static/front.png: a scene with its exact shadows, and one shadow edge magnified under several
techniques. `gallery` runs every experiment and keeps its figure and its claims in docs/_static/gallery.
"""

import io
import json
import sys
import tempfile
from pathlib import Path

import jax.numpy as jnp
import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

import shadowjax as sj
from shadowjax.geometry.smoothing import smooth_corner_groups
from shadowjax.rays.casters import default_caster

SCENE = "smooth-and-abrupt"
WIDTH, HEIGHT, SAMPLES, TEXELS = 720, 450, 2, 256
LEFT, TOP, CROP_WIDTH, CROP_HEIGHT = 106, 242, 72, 54  # pixels of the picture that are magnified
NAMES = ["exact", "hard", "pcf-4x4", "2sm-max+pcf-3x3", "3sm+pcf-3x3"]
TITLES = ["exact", "hard test", "PCF 4×4", "2-SM, PCF 3×3", "3-SM, PCF 3×3"]
STATIC = Path(__file__).parent / "_static"


def pictures() -> tuple[np.ndarray, list[np.ndarray], list[int | None]]:
    """The large picture, the crops, and the bound on tones of each technique."""
    scene = sj.make_scene(SCENE)
    camera = sj.Camera(
        scene.camera.position, scene.camera.rotation, scene.camera.phi_y * 0.83, jnp.asarray(WIDTH / HEIGHT),
        scene.camera.near, scene.camera.far,
    )  # fmt: skip
    caster, groups = default_caster(), smooth_corner_groups(scene.mesh)
    surface = sj.trace_surface(scene.mesh, camera, WIDTH, HEIGHT, caster, groups, SAMPLES)

    def picture(name: str) -> tuple[np.ndarray, int | None]:
        technique = sj.make_technique(name, TEXELS, caster)
        visibility = sj.visibility_on(surface, technique.build(scene.mesh, scene.lights[0], camera))
        image = sj.shade(surface, scene.lights, (visibility,), samples_per_axis=SAMPLES)
        return np.clip(np.asarray(image), 0, 1), technique.num_tones

    crop = (slice(TOP, TOP + CROP_HEIGHT), slice(LEFT, LEFT + CROP_WIDTH))
    images = [picture(name) for name in NAMES]
    return images[0][0], [image[crop] for image, _ in images], [tones for _, tones in images]


def draw(large: np.ndarray, crops: list[np.ndarray], tones: list[int | None]) -> Figure:
    """The large picture over a row of crops."""
    count = len(crops)
    width = WIDTH / 100  # inches: at 200 dpi a pixel of the large picture takes 2 × 2, of a crop 4 × 4
    upper, lower = width * HEIGHT / WIDTH, width / count * CROP_HEIGHT / CROP_WIDTH
    gap = 0.36
    height = upper + lower + gap
    figure = Figure(figsize=(width, height), facecolor="white")
    axes = figure.add_axes((0, (lower + gap) / height, 1, upper / height))
    axes.imshow(large, interpolation="nearest", aspect="auto")
    axes.add_patch(Rectangle((LEFT, TOP), CROP_WIDTH, CROP_HEIGHT, fill=False, edgecolor="#b3401a", linewidth=1.6))
    axes.set_axis_off()
    for index, (crop, title, bound) in enumerate(zip(crops, TITLES, tones, strict=True)):
        cell = figure.add_axes((index / count + 0.003, 0, 1 / count - 0.006, lower / height))
        cell.imshow(crop, interpolation="nearest", aspect="auto")
        cell.set_axis_off()
        label = f"{title}\n" + ("the reference" if index == 0 else f"at most {bound} tones")
        figure.text((index + 0.5) / count, (lower + 0.06) / height, label, ha="center", fontsize=6.5, color="#333333")
    return figure


def save(png: bytes, target: Path) -> None:
    """Write a picture without transparency; one of more than 200 kB is a plot, and loses nothing with 256 colours."""
    image = Image.open(io.BytesIO(png)).convert("RGB")
    image.save(target, optimize=True)
    if target.stat().st_size > 200_000:
        image.quantize(256).save(target, optimize=True)
    print(f"{target.name}: {image.width} × {image.height}, {target.stat().st_size // 1024} KiB")


def front() -> None:
    """The picture of the first page."""
    matplotlib.rcParams["font.family"] = "DejaVu Sans"
    buffer = io.BytesIO()
    draw(*pictures()).savefig(buffer, dpi=200, format="png")
    save(buffer.getvalue(), STATIC / "front.png")


def keep(source: Path) -> None:
    """Take figures and claims of finished experiments over into the gallery."""
    target = STATIC / "gallery"
    target.mkdir(exist_ok=True)
    for record in sorted(source.glob("*.json")):
        save(record.with_suffix(".png").read_bytes(), target / f"{record.stem}.png")
        if record.with_suffix(".gif").exists():
            (target / f"{record.stem}.gif").write_bytes(record.with_suffix(".gif").read_bytes())
        claims = json.loads(record.read_text())["claims"]
        (target / record.name).write_text(json.dumps({"claims": claims}, ensure_ascii=False, indent=1) + "\n")


def gallery() -> int:
    """Run every experiment; 1 if a claim fails, and then nothing is kept."""
    from experiments.__main__ import main as run_experiments

    with tempfile.TemporaryDirectory() as folder:
        code = run_experiments(["all", "--out", folder])
        if code == 0:
            keep(Path(folder))
    return code


def main(arguments: list[str]) -> int:
    """Make what is asked for."""
    if arguments not in (["front"], ["gallery"], ["all"]):
        print("usage: python docs/pictures.py front | gallery | all", file=sys.stderr)
        return 2
    if arguments != ["gallery"]:
        front()
    return 0 if arguments == ["front"] else gallery()


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))  # for `experiments`, which is not installed
    raise SystemExit(main(sys.argv[1:]))
