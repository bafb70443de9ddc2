"""Write formulas as MathML, which browsers draw without a script and without a network."""

import re
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

# docutils draws the index of an accented letter, as in \bar e_j, under the letter instead of beside it.
ACCENTED = re.compile(
    r"<munderover>\s*(<mi>[^<]*</mi>)\s*(.*?)\s*(<mo stretchy=\"false\">.</mo>)\s*</munderover>", re.S
)

# The bars of a norm are of one height: browsers stretch only those that they take for fences.
BAR = re.compile(r"<mo(?: class=\"mathopen\")?>‖</mo>")
# Named functions stand apart from what is before and after them, unless that is a parenthesis.
FUNCTION = r"<mi[^>]*>[a-z]+</mi>\s*<mo>&ApplyFunction;</mo>"
BEFORE = re.compile(rf"(</(?:mi|mn|msub|msup|msubsup)>)(?=\s*{FUNCTION})")
AFTER = re.compile(rf"({FUNCTION})(?!\s*(?:<mrow>\s*)?<mo[^>]*>[(\[])")
THIN = '<mspace width="0.167em"></mspace>'


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer `mathml` for inline formulas and for those on lines of their own."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def visit_inline(translator: HTML5Translator, node: nodes.math) -> None:
    """Write one formula of a sentence."""
    translator.body.append(mathml(node, as_block=False))
    raise nodes.SkipNode


def visit_block(translator: HTML5Translator, node: nodes.math_block) -> None:
    """Write one formula on lines of its own, which scrolls where the page is narrow."""
    translator.body.append(f'<div class="formula">{mathml(node, as_block=True)}</div>\n')
    raise nodes.SkipNode


def mathml(node: nodes.math | nodes.math_block, *, as_block: bool) -> str:
    """Translate a formula in TeX as docutils does, but for what browsers would draw amiss."""
    formula = tex2mathml(node.astext(), as_block=as_block)
    formula = ACCENTED.sub(r'<msub><mover accent="true">\1\3</mover>\2</msub>', formula)
    formula = BAR.sub('<mo stretchy="false">‖</mo>', formula)
    return AFTER.sub(rf"\1{THIN}", BEFORE.sub(rf"\1{THIN}", formula))
