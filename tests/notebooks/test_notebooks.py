"""Every notebook of the site runs from top to bottom in a kernel of its own, with warnings as errors."""

from pathlib import Path

import jupytext
import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted(path for path in (ROOT / "docs").rglob("*.md") if path.read_text().startswith("---\njupytext:"))

# The kernel's own shutdown warns about itself; everything that a cell does may not.
STRICT = """\
import warnings
warnings.simplefilter("error")
warnings.filterwarnings("ignore", module="ipykernel")
"""


def execute(notebook: nbformat.NotebookNode, folder: Path) -> nbformat.NotebookNode:
    """Run all cells in `folder`; an exception in a cell is raised here."""
    notebook.cells.insert(0, nbformat.v4.new_code_cell(STRICT))
    return NotebookClient(
        notebook, timeout=180, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    ).execute()


@pytest.fixture
def kernel_environment(monkeypatch):
    """What a kernel needs to find the package and to reuse compiled programs."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(ROOT / ".jax_cache"))
    monkeypatch.setenv("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")


def test_the_notebooks_are_found():
    found = {path.stem for path in NOTEBOOKS}
    assert found >= {"from_scratch", "multi_depth", "differentiability"}
    assert found >= {"texel_grid", "one_slider", "how_many_cascades", "derive_near_distance"}


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path, tmp_path, kernel_environment):
    notebook = execute(jupytext.read(path), tmp_path)
    ran = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert len(ran) > 5
    assert all(cell.execution_count for cell in ran)
    assert not list(tmp_path.iterdir()), "a notebook must not leave files behind"


@pytest.mark.parametrize("source", ["assert 1 == 2", "import warnings; warnings.warn('careful')"])
def test_a_failing_or_warning_cell_fails(source, tmp_path, kernel_environment):
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source)])
    with pytest.raises(Exception, match=r"AssertionError|UserWarning"):
        execute(notebook, tmp_path)
