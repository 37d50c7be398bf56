"""Hooks of mkdocs.yml: files of the repository outside docs/ that pages link to come into the site.

README.md, CONTRIBUTING.md and CHANGELOG.md become pages, the README the front page; all others are copied to files/.
Links lead to where a file is in the site, so that the same pages work in the repository. Each example of the gallery
has a link to its scene and, where `scripts/study gallery --views docs/start/views` has written it, its view.
"""

import json
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.plugins import event_priority
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]

GALLERY = "start/gallery.md"

RUN = re.compile(r"^```\nscripts/run\.sh (configs/(?:\w+/)*(\w+)\.toml)\n```$", re.M)
"""The command at the end of an example of the gallery: the file of its scene, and its name."""

PAGES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")

LINK = re.compile(r"(?<=\]\()(?!\w+:|[#/<])([^()\s#]+)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the three pages, and what any page links to outside docs/."""
    for name in PAGES:
        files.append(
            File.generated(config, name, content=(ROOT / name).read_text(encoding="utf-8"))
        )
    for file in files.documentation_pages():
        text = _with_links(file.content_string) if file.src_uri == GALLERY else file.content_string
        for target in _targets(file.src_uri, text):
            if files.get_file_from_path(_place(target)) is None and (ROOT / target).is_file():
                files.append(
                    File.generated(config, _place(target), content=(ROOT / target).read_bytes())
                )
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead links from where files are in the repository to where they are in the site."""
    source = page.file.src_uri
    if source == GALLERY:
        markdown = _with_links(markdown)

    def lead(link: re.Match) -> str:
        target = _place(_resolve(source, link[1]))
        return posixpath.relpath(target, posixpath.dirname(source) or ".")

    return LINK.sub(lead, markdown)


@event_priority(-100)  # after the search plugin has written its files
def on_post_build(config: MkDocsConfig) -> None:
    """Let the search work from files, too: browsers load neither workers nor data from file:// addresses.

    The script of the pages gets the worker, its library and the index as text, and starts the worker from that.
    """
    folder = Path(config.site_dir, "search")
    library, worker, index, main = (
        (folder / name).read_text(encoding="utf-8")
        for name in ("lunr.js", "worker.js", "search_index.json", "main.js")
    )
    source = f"""{library}
{worker}
self.importScripts = function () {{}};
init = function () {{ onJSONLoaded.call({{responseText: {json.dumps(index)}}}); }};
"""
    call = 'new Worker(joinUrl(base_url, "search/worker.js"))'
    if call not in main:
        raise PluginError(
            "the search of this version of mkdocs starts its worker otherwise: adapt docs/site_hooks.py"
        )
    started = f"new Worker(URL.createObjectURL(new Blob([{json.dumps(source)}])))"
    (folder / "main.js").write_text(main.replace(call, started), encoding="utf-8")


def _with_links(gallery: str) -> str:
    """The gallery with a link to the scene, and to the view if there is one, below each example."""

    def links(command: re.Match) -> str:
        view = f"views/{command[2]}.html"
        turn = (
            f" · [Its results, in the browser]({view})"
            if (ROOT / "docs" / "start" / view).exists()
            else ""
        )
        return f"{command[0]}\n\n[Its scene](../../{command[1]}){turn}"

    return RUN.sub(links, gallery)


def _targets(source: str, markdown: str) -> Iterator[str]:
    return (_resolve(source, link) for link in LINK.findall(markdown))


def _resolve(source: str, link: str) -> str:
    """The path in the repository that a page's link leads to."""
    page = source if source in PAGES else f"docs/{source}"
    return posixpath.normpath(posixpath.join(posixpath.dirname(page), link))


def _place(path: str) -> str:
    """Where a file of the repository is in the site."""
    if path in PAGES:
        return path
    return path.removeprefix("docs/") if path.startswith("docs/") else f"files/{path}"
