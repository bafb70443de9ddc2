"""Run tutorials, and keep in them what their cells print and show: `make tutorials`.

    python docs/tools/tutorial_outputs.py docs/tutorials/*.ipynb

Each runs in a folder of its own that is removed. Pictures are kept in 256 colours, a third of their size.
"""

import base64
import sys
import tempfile
from io import BytesIO
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from PIL import Image


def small(picture: str) -> str:
    """Give a PNG, in base64, in 256 colours."""
    buffer = BytesIO()
    shown = Image.open(BytesIO(base64.b64decode(picture))).convert("RGB")
    shown.quantize(256).save(buffer, "png", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()


def keep(notebook: Any) -> Any:
    """Make the pictures of a notebook's outputs small; leave out what differs from machine to machine."""
    notebook.metadata = {"kernelspec": notebook.metadata["kernelspec"], "language_info": {"name": "python"}}
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        outputs = [output for output in cell.get("outputs", ()) if output.get("name") != "stderr"]
        for output in outputs:
            if picture := output.get("data", {}).get("image/png"):
                output["data"]["image/png"] = small(picture)
        if cell.cell_type == "code":
            cell.outputs = outputs
    return notebook


def main(paths: list[Path]) -> None:
    """Run each notebook, and write it again with its outputs."""
    for path in paths:
        notebook = nbformat.read(path, as_version=4)
        with tempfile.TemporaryDirectory() as folder:
            NotebookClient(notebook, timeout=300, resources={"metadata": {"path": folder}}).execute()
        nbformat.write(keep(notebook), path)
        print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main([Path(word) for word in sys.argv[1:]])
