"""The built pages: lists are lists, names and numbers break at good places, and nothing comes from
the network.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import markdown
import pytest
from docs.page_hooks import on_page_content, on_post_template

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
LINE = 84  # characters
EXTENSIONS = [
    "admonition",
    "attr_list",
    "tables",
    "toc",
    "pymdownx.highlight",
    "pymdownx.superfences",
]  # those of mkdocs.yml


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_lists_are_lists(page):
    """A list directly after a paragraph, or after a paragraph that is not indented by four, becomes
    a part of it.
    """
    built = markdown.markdown(page.read_text(), extensions=EXTENSIONS)
    assert re.findall(r"<p>(?:(?!</p>).)*?\n *- ", built, re.S) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_lines_of_code_fit_the_page(page):
    """Commands may be longer: the built page wraps them."""
    blocks = re.findall(r"^```(?!console)\S.*\n((?:(?!```).*\n)*)", page.read_text(), re.M)
    assert [line for block in blocks for line in block.splitlines() if len(line) > LINE] == []


def test_pictures_lead_to_themselves():
    assert (
        on_page_content('<p><img alt="A map" src="../a.png" width="9" /></p>')
        == '<p><a href="../a.png"><img alt="A map" src="../a.png" width="9" /></a></p>'
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("<code>max_moves</code>", "<code>max_<wbr>moves</code>"),
        ("<code>vessels:5000</code> vessels:5000", "<code>vessels:<wbr>5000</code> vessels:5000"),
        ("<code>a.b</code>", "<code>a.<wbr>b</code>"),
        ("<code>shoal.swarm</code> 0.5 2,500", "<code>shoal.<wbr>swarm</code> 0.5 2,500"),
        (
            "<code>a=3 crash:2@20 3:4 a/b</code>",
            "<code>a=<wbr>3 crash:<wbr>2@<wbr>20 3:4 a/b</code>",
        ),
        (
            "docs/errata and list[int,str,float]",
            "docs/errata and list<wbr>[int,<wbr>str,<wbr>float]",
        ),
        ('<a href="docs/a.html">x</a>', '<a href="docs/a.html">x</a>'),
    ],
)
def test_names_in_tables_break_at_good_places(text, expected):
    assert on_page_content(f"<p>{text}</p><td>{text}</td>") == f"<p>{text}</p><td>{expected}</td>"


def test_options_stay_in_one_piece():
    code = "<pre><code>$ shoal -n 3 --scan-every=2 wall-clock -1</code></pre> --film"
    spans = code.replace("-n", '<span class="option">-n</span>').replace(
        "--scan-every", '<span class="option">--scan-every</span>'
    )
    assert on_page_content(code) == spans


def test_numbers_stay_with_their_units():
    text = "<p>0.81 ± 0.05, 13 % of 1.8\nms, 5 m/s, 3 moves</p><code>2 m</code>"
    expected = "<p>0.81\xa0±\xa00.05, 13\xa0% of 1.8\xa0ms, 5\xa0m/s, 3 moves</p><code>2 m</code>"
    assert on_page_content(text) == expected


def test_formulas_have_indices_and_powers():
    text = (
        "<p>p_1 + R_{k+2} of goal_x, p'_i, c_i²: 10^100, (k-1)^(k-1), 2^order,"
        " (2r)^(1/2^m)</p><code>p_1</code>"
    )
    expected = (
        text.replace("p_1 ", "p<sub>1</sub> ")
        .replace("R_{k+2}", "R<sub>k+2</sub>")
        .replace("c_i", "c<sub>i</sub>")
    )
    expected = (
        expected.replace("'_i", "'<sub>i</sub>")
        .replace("^100", "<sup>100</sup>")
        .replace("^(k-1)", "<sup>k-1</sup>")
    )
    expected = expected.replace("^order", "<sup>order</sup>")
    assert on_page_content(text) == expected.replace("^(1/2^m)", "<sup>1/2<sup>m</sup></sup>")


def test_no_dash_stands_before_an_empty_description():
    item = '<li><b>a</b>\n \N{EN DASH}\n <div class="doc-md-description">\n{}</div></li>'
    assert on_page_content(item.format("")) == "<li><b>a</b></li>"
    assert on_page_content(item.format("A")) == item.format("A")


def test_the_page_for_missing_pages_asks_nothing_of_the_network():
    built = '<script src="https://unpkg.com/iframe-worker/shim"></script><h1>404</h1>'
    mended = on_post_template(built, template_name="404.html", config=None)
    assert "://" not in mended
    assert 'href="/index.html"' in mended
    assert on_post_template(built, template_name="sitemap.xml", config=None) == built


def test_the_page_install_lists_all_extras():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    table = re.search(
        r"^\| extra \|.*\n\|-.*\n((?:\|.*\n)+)", (ROOT / "docs/index.md").read_text(), re.M
    )
    listed = [
        name
        for row in table[1].splitlines()
        for name in re.findall("`([a-z]+)`", row.split("|")[1])
    ]
    assert sorted(listed) == sorted(project["optional-dependencies"])
