"""The site: built as `make site` builds it, its links, what it lists, and what a browser without a network shows."""

import fcntl
import html
import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

import elliptude
import pytest
from browsers import chromium, offline, screenshots
from elliptude.cli import application

ROOT = Path(__file__).parents[3]
# Attributes whose address a browser fetches by itself; others are followed by a reader.
FETCHED = {("script", "src"), ("img", "src"), ("link", "href"), ("source", "src"), ("iframe", "src")}
PHONE, DESK = {"width": 390, "height": 844}, {"width": 1280, "height": 900}

# Looked for, not imported: what they warn of is no concern of these tests.
if not all(map(find_spec, ("sphinx", "furo", "myst_nb", "numpydoc", "sphinx_copybutton", "latex2mathml"))):
    pytest.skip("the extra docs is not installed: make requirements", allow_module_level=True)


class Page(HTMLParser):
    """What a page links to, what it fetches, and the places in it that can be linked to."""

    def __init__(self, path: Path):
        super().__init__()
        self.path, self.links, self.fetched, self.anchors = path, [], [], set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if name == "id" or (tag == "a" and name == "name"):
                self.anchors.add(value)
            elif name in {"href", "src"} and value is not None:
                (self.fetched if (tag, name) in FETCHED else self.links).append(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the site, built once for all processes that test."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if re.fullmatch(r"popen-\w+", base.name) else base
    folder = shared / "documentation" / "site"
    folder.parent.mkdir(exist_ok=True)
    with (folder.parent / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder.parent / "built").exists():
            command = [str(ROOT / "tools" / "build_site.sh"), sys.executable, str(folder)]
            done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=1200)
            assert done.returncode == 0, done.stdout + done.stderr
            (folder.parent / "built").touch()
    return folder


@pytest.fixture(scope="module")
def pages(site):
    found = {path: Page(path) for path in site.rglob("*.html") if "_static" not in path.parts}
    assert len(found) > 30
    return found


NOTEBOOKS = {
    "ahrs_from_arrays": "in the set at every row: True",
    "calibration": "true offset within all: True",
    "empty_intersection": "inside at every row: True",
    "first_estimate": "inside at every row: True",
    "monitor": "the error is between both at every row: True",
    "own_potential": "magnet nothing refused\nfree body first refused at 20 s",
    "pendulum": "guaranteed, inside at every row: True",
    "smoothing": "smoothed: inside at 100 % of rows",
    "spacecraft": "inside at every row: True",
}
"""What each prints, if it is as its text says."""


def code_cells(path):
    return [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]


def test_the_notebooks_are_kept_without_outputs():
    kept = {path.stem: code_cells(path) for path in (ROOT / "docs" / "notebooks").glob("*.ipynb")}
    assert set(kept) == set(NOTEBOOKS)
    for name, code in kept.items():
        assert 4 <= len(code) <= 8, name
        assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code), name


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_has_run(site, name):
    """The site's build runs them all, and fails for an error in one."""
    code = code_cells(site.parent / "jupyter_execute" / "docs" / "notebooks" / f"{name}.ipynb")
    outputs = [output for cell in code for output in cell["outputs"]]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    said = "".join("".join(output.get("text", "")) for output in outputs)
    assert NOTEBOOKS[name] in said
    assert not any(output.get("name") == "stderr" for output in outputs)
    assert "_images/" in (site / "docs" / "notebooks" / f"{name}.html").read_text(encoding="utf-8")


def dead_links(pages, site):
    """Links within the site that lead nowhere, each with its page."""
    dead = []
    for path, page in pages.items():
        for address in page.links + page.fetched:
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchor = unquote(parts.fragment)
            known = target.is_file() and target.is_relative_to(site.resolve())
            if not known or (anchor and target in pages and anchor not in pages[target].anchors):
                dead.append(f"{path.relative_to(site)}: {address}")
    return dead


def test_no_link_is_dead(pages, site):
    assert sum(len(page.links) for page in pages.values()) > 2000
    assert dead_links(pages, site) == []


def test_a_dead_link_would_be_found(tmp_path):
    (tmp_path / "one.html").write_text('<a href="two.html">there</a><a href="#here">here</a><p id="now">')
    pages = {tmp_path / "one.html": Page(tmp_path / "one.html")}
    assert dead_links(pages, tmp_path) == ["one.html: two.html", "one.html: #here"]


def test_nothing_is_fetched_from_a_network(pages, site):
    assert [address for page in pages.values() for address in page.fetched if urlsplit(address).netloc] == []
    for style in site.rglob("*.css"):
        assert (
            re.findall(r"(?:@import\s+|url\()[\"']?(?:https?:)?//[^)\"']+", style.read_text(encoding="utf-8")) == []
        ), style


def test_every_page_of_the_documentation_is_there(site):
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").glob("*.md")]:
        assert (site / page.relative_to(ROOT)).with_suffix(".html").is_file()


def test_the_manual_page_has_every_command(site):
    page = re.sub(r"\\f[BIPR]", "", (site / "elliptude.1").read_text(encoding="utf-8"))  # without its fonts
    assert page.count('.TH "ELLIPTUDE" "1"') == 1
    assert "<>" not in page
    assert all(re.search(rf"\b{command}\b", page) for command in application.COMMANDS)


def test_every_public_name_is_in_the_reference(pages, site):
    anchors = set().union(*(page.anchors for path, page in pages.items() if path.parent == site / "docs" / "reference"))
    assert {name for name in elliptude.__all__ if f"elliptude.{name}" not in anchors} == set()


def test_compiled_functions_have_the_types_of_the_stubs(site):
    page = (site / "docs" / "reference" / "rotations.html").read_text(encoding="utf-8")
    text = html.unescape(re.sub(r"<[^>]*>", "", page))
    assert re.search(r"elliptude\.exp\(rotation_vector:\s*ArrayLike\)\s*→\s*ndarray", text)


def test_formulas_are_formulas(pages, site):
    theory = (site / "docs" / "theory.html").read_text(encoding="utf-8")
    assert theory.count("<math") > 2500
    text = re.sub(r"<(script|style)\b.*?</\1>", "", theory, flags=re.DOTALL)
    assert "$" not in re.sub(r"<[^>]*>", "", text)
    assert "ℳ" in theory  # browsers have letters of other alphabets only by themselves
    assert 'mathvariant="script"' not in theory
    assert len(re.findall(r'<span class="number">\(\d+\.\d+\)</span>', theory)) > 100


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


def test_on_a_phone_no_page_scrolls_sideways(browser, pages, tmp_path):
    with offline(browser, viewport=PHONE, color_scheme="dark") as page:
        for path in pages:
            if path.name != "index.html":  # which leads to the first page
                page.goto(path.as_uri())
                assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"], path
                red, green, blue = map(int, re.findall(r"\d+", background(page))[:3])
                assert max(red, green, blue) < 60, f"{path} is bright in the dark"
        page.goto(next(path for path in pages if path.name == "theory.html").as_uri())
        page.screenshot(path=screenshots(tmp_path) / "site-phone.png")


def background(page):
    return page.evaluate("getComputedStyle(document.body).backgroundColor")


def test_at_a_desk_in_the_light(browser, site, tmp_path):
    with offline(browser, viewport=DESK, color_scheme="light") as page:
        page.goto((site / "index.html").as_uri())
        page.wait_for_url("**/README.html")
        assert background(page) == "rgb(255, 255, 255)"
        page.screenshot(path=screenshots(tmp_path) / "site.png")
        page.get_by_role("link", name="Guide", exact=True).first.click()
        page.wait_for_url("**/docs/guide.html")


def test_the_search_finds_what_is_asked(browser, site):
    with offline(browser, viewport=DESK) as page:
        page.goto((site / "search.html").as_uri() + "?q=GuaranteedGyroFlow")
        page.wait_for_selector("ul.search a")
        found = page.eval_on_selector_all("ul.search a", "links => links.map(link => link.getAttribute('href'))")
    assert any(link.startswith("docs/reference/guaranteed.html") for link in found), found
