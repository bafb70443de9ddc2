"""Settings of the documentation's site: `make docs` builds it into docs/_build, without a network."""

import hashlib
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

import tactsim  # noqa: E402

SOURCE = hashlib.sha256()
for room in sorted(Path(tactsim.__file__).parent.iterdir()):
    for path in sorted(room.rglob("*.py")):
        SOURCE.update(path.read_bytes())

project = "tactsim"
author = "The tactsim authors"
html_title = "tactsim"

extensions = ["myst_nb", "sphinx.ext.autodoc", "mathml", "from_source", "intervals"]
exclude_patterns = ["_build", "_ext", "tools", "requirements.lock"]
smartquotes = False  # it would turn --option into a dash
show_warning_types = True

# Pages are Markdown as GitHub shows it too: $...$ and ```math for formulas, anchors of headings as there.
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

# Notebooks are run while the site is built, again only after they or the package have changed.
nb_execution_mode = "cache"
nb_execution_cache_path = str(HERE / "_build" / "notebooks" / SOURCE.hexdigest()[:16])
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_execution_in_temp = True
nb_merge_streams = True
nb_output_stderr = "remove"  # progress, not results

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "FloatArray": "FloatArray"}
default_role = "code"
python_use_unqualified_type_names = True
add_module_names = False

# Nothing is fetched: the theme's fonts are the reader's own, formulas are MathML.
html_theme = "furo"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_extra_path = ["llms.txt"]
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}
