"""The pages of docs/ and those beside them make a site without links to nowhere."""

import re
import sys
from pathlib import Path

import pytest
from commands import run

ROOT = Path(__file__).resolve().parents[2]
LOADED = re.compile(
    r"<(?:script|img|iframe)\b[^>]*\bsrc=\"(https?:)?//|<link\b[^>]*\bhref=\"(https?:)?//"
)


@pytest.mark.slow
def test_site(tmp_path):
    """The site is built without a warning: all links and anchors lead somewhere. Nothing is loaded from outside."""
    pytest.importorskip("mkdocs", reason="needs mkdocs")
    run(
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "--site-dir",
        tmp_path / "site",
        cwd=ROOT,
    )
    pages = {
        path.relative_to(tmp_path / "site").as_posix(): path.read_text(encoding="utf-8")
        for path in (tmp_path / "site").rglob("*.html")
    }
    assert {
        "index.html",
        "CONTRIBUTING.html",
        "reference/scene.html",
        "tables/verification.html",
    } <= pages.keys()
    scenes = re.findall(
        r'href="\.\./(files/configs/[\w/]+\.toml)">Its scene', pages["start/gallery.html"]
    )
    assert len(scenes) == pages["start/gallery.html"].count("<h2 ")
    assert all((tmp_path / "site" / path).exists() for path in scenes)
    for name, text in pages.items():
        assert not LOADED.search(text), name


def test_a_readme_of_two_screens():
    """The README stays short; what is more stands in docs/."""
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 100
    assert max(map(len, lines)) <= 120
