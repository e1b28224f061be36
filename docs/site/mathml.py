"""Formulas as MathML, which browsers show by themselves: no script, and nothing to fetch.

latex2mathml reads the formula; `as_tex_would` puts right what browsers would space or draw otherwise than TeX.
"""

import re
import unicodedata
from html import escape
from typing import Any
from xml.etree import ElementTree

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)

Element = ElementTree.Element
NAMESPACE = "http://www.w3.org/1998/Math/MathML"
ElementTree.register_namespace("", NAMESPACE)

TAG = re.compile(r"\\tag\{([^}]*)\}")
# latex2mathml leaves the names of these where they follow \big and \Big.
NAMED = {"lVert": "‖", "rVert": "‖", "Vert": "‖", "lvert": "|", "rvert": "|", "vert": "|", "lbrace": "{", "rbrace": "}"}
ALPHABETS = {"script": "SCRIPT", "double-struck": "DOUBLE-STRUCK"}
BARS, OPENING, CLOSING = "‖|", "([{⟨", ")]}⟩‖|!"
THIN = "0.1667em"


def local(element: Element) -> str:
    """The name of an element, without its namespace."""
    return element.tag.removeprefix(f"{{{NAMESPACE}}}")


def letter_of(alphabet: str, letter: str) -> str:
    """A letter of a mathematical alphabet: browsers know the letters, not the attribute `mathvariant`."""
    name = f"{alphabet} CAPITAL {letter}"
    try:
        return unicodedata.lookup(f"MATHEMATICAL {name}")
    except KeyError:
        return unicodedata.lookup(name)


def base_of(element: Element) -> Element:
    """What an element's indices and exponents are at."""
    while local(element) in {"msup", "msub", "msubsup", "munder", "munderover"}:
        element = element[0]
    return element


def is_name(element: Element) -> bool:
    """Whether it is the name of a function, such as sin or tr."""
    text = base_of(element).text or ""
    return len(text) > 1 and text.isascii() and text.isalnum() and local(base_of(element)) == "mi"


def is_operator(element: Element) -> bool:
    """Whether it is an operator or a delimiter that begins something: no space is between it and a name or a sign."""
    base = base_of(element)
    return local(base) == "mspace" or (local(base) == "mo" and (base.text or "") not in CLOSING)


def joined_names(element: Element) -> None:
    r"""Letters of \mathrm become one name."""
    for child in element:
        joined_names(child)
    upright = [one for one in element if one.get("mathvariant") == "normal" or local(one) == "mn"]
    if local(element) == "mrow" and len(upright) == len(element) > 1 and local(element[0]) == "mi":
        element.tag, element.text = f"{{{NAMESPACE}}}mi", "".join(one.text or "" for one in element)
        element[:] = []


def put_right(element: Element) -> None:
    """One identifier or operator."""
    text = element.text or ""
    if text.startswith("\\"):
        text = element.text = NAMED.get(text[1:], text)
    if element.get("mathvariant") in ALPHABETS:
        element.text = letter_of(ALPHABETS[element.attrib.pop("mathvariant")], text)
    if (text and text in BARS + "{}/:") or text in {"max", "min", "det", "sup"}:
        element.tag = f"{{{NAMESPACE}}}{'mi' if text.isalpha() else 'mo'}"
    if text and text in BARS + "/":
        element.attrib |= {"lspace": "0", "rspace": "0"}
        if "minsize" not in element.attrib:
            element.set("stretchy", "false")


def spaced(row: Element) -> None:
    """Space about names of functions, and none after signs."""
    before: Element | None = None
    for child in list(row):
        base = base_of(child)
        begins = before is None or is_operator(before)
        if local(base) == "mo" and (base.text or "") in "−+±" and begins:
            base.attrib |= {"form": "prefix", "lspace": "0", "rspace": "0"}
        opens = local(base) == "mo" and (base.text or "") in OPENING + CLOSING
        ends_word = before is not None and not is_operator(before)
        if before is not None and (
            (is_name(child) and ends_word) or (is_name(before) and not opens and local(base) not in {"mo", "mspace"})
        ):
            row.insert(list(row).index(child), Element(f"{{{NAMESPACE}}}mspace", {"width": THIN}))
        before = child


def as_tex_would(formula: str) -> str:
    """The same MathML with letters, delimiters and spaces as TeX has them."""
    root = ElementTree.fromstring(formula)
    joined_names(root)
    for element in root.iter():
        if local(element) in {"mi", "mo"}:
            put_right(element)
    for element in list(root.iter()):
        spaced(element) if local(element) == "mrow" else None
    return ElementTree.tostring(root, encoding="unicode")


def mathml(formula: str, display: str, place: nodes.Node) -> str:
    """The formula, with a warning where it cannot be turned into MathML."""
    found = as_tex_would(convert(formula, display=display))
    if "\\" in found:
        logger.warning("a formula that latex2mathml cannot read: %s", formula, location=place)
    return found


def visit_inline(self: Any, node: nodes.math) -> None:
    """A formula in a line of text."""
    self.body.append(f'<span class="math">{mathml(node.astext(), "inline", node)}</span>')
    raise nodes.SkipNode


def visit_block(self: Any, node: nodes.math_block) -> None:
    """A formula by itself, with its number at the right."""
    formula = node.astext()
    tag = TAG.search(formula)
    number = f'<span class="number">({escape(tag[1])})</span>' if tag else ""
    shown = mathml(TAG.sub("", formula), "block", node)
    self.body.append(f'<div class="math"><div class="formula">{shown}</div>{number}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """What Sphinx calls."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
