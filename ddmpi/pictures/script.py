"""The script of view.html, by which pages let it run and no other."""

import base64
import hashlib
import re
from importlib import resources


def view_template() -> str:
    """The template of view.html, which lets its own script run."""
    return _raw().replace("$script", our_digest())


def _raw() -> str:
    return resources.files("ddmpi.pictures").joinpath("view.html").read_text(encoding="utf-8")


def digest(page: str) -> str:
    """How a Content-Security-Policy names the last script of a page; empty where there is none."""
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    hashed = hashlib.sha256(scripts[-1].encode()).digest() if scripts else b""
    return f"'sha256-{base64.b64encode(hashed).decode()}'" if scripts else ""


def our_digest() -> str:
    """`digest` of the views that this version writes."""
    return digest(_raw().replace("$$", "$"))
