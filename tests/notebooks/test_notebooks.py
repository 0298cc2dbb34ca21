"""Every notebook of the site runs to its end, with warnings as errors; the site's build runs them in kernels."""

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path

import jax
import jupytext
import matplotlib.pyplot as plt
import nbformat
import pytest
from IPython.core.interactiveshell import InteractiveShell
from traitlets.config import Config

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted(path for path in (ROOT / "docs").rglob("*.md") if path.read_text().startswith("---\njupytext:"))
# What a reader's JAX starts with, where the tests' differs.
READERS = {"jax_enable_x64": False, "jax_numpy_dtype_promotion": "standard", "jax_debug_nans": False}


class Shell(InteractiveShell):
    """Runs cells without a window."""

    def enable_gui(self, gui=None):
        """Nothing to do: `%matplotlib inline` asks for it."""


@contextlib.contextmanager
def as_a_reader(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Shell]:
    """A fresh shell in `folder`: in this process, so that notebooks and tests share imports and compiled programs."""
    kept = {name: jax.config.values[name] for name in READERS}
    backend = plt.get_backend()
    monkeypatch.chdir(folder)
    shell = Shell(config=Config(HistoryManager={"enabled": False}))
    for name, value in READERS.items():
        jax.config.update(name, value)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield shell
    finally:
        for name, value in kept.items():
            jax.config.update(name, value)
        plt.close("all")
        plt.switch_backend(backend)


def execute(notebook: nbformat.NotebookNode, shell: Shell) -> int:
    """Run all code cells, raise what a cell raises, and count them."""
    cells = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    for source in cells:
        shell.run_cell(source).raise_error()
    return len(cells)


def test_the_notebooks_are_found():
    found = {path.stem for path in NOTEBOOKS}
    assert found >= {"from_scratch", "multi_depth", "differentiability"}
    assert found >= {"texel_grid", "one_slider", "how_many_cascades", "derive_near_distance"}


# The site's build runs all of them, without the warnings as errors.
ALWAYS = ("from_scratch", "multi_depth")


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=[] if path.stem in ALWAYS else pytest.mark.long, id=path.stem) for path in NOTEBOOKS],
)
def test_notebook_runs(path, tmp_path, monkeypatch):
    with as_a_reader(tmp_path, monkeypatch) as shell:
        assert execute(jupytext.read(path), shell) > 5
    assert not list(tmp_path.iterdir()), "a notebook must not leave files behind"
    assert jax.config.values["jax_enable_x64"] is True


@pytest.mark.parametrize("source", ["assert 1 == 2", "import warnings; warnings.warn('careful')"])
def test_a_failing_or_warning_cell_fails(source, tmp_path, monkeypatch):
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source)])
    with as_a_reader(tmp_path, monkeypatch) as shell, pytest.raises((AssertionError, UserWarning)):
        execute(notebook, shell)
