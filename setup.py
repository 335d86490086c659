"""What a package index shows. All else is in pyproject.toml.

An index shows the README without its folder: its pictures and links must say where the project is published.
Whoever builds for one says so, as PROJECT_URL=https://github.com/OWNER/NAME; without it they stay as they are.
"""

import os
import re
from pathlib import Path


def absolute_links(text: str, url: str) -> str:
    """``text`` with every link into the project leading to ``url``, pictures to the files themselves."""

    def absolute(found: re.Match) -> str:
        shown, target = found["shown"], found["target"]
        if re.match(r"https?:|mailto:|#", target):
            return found[0]
        return f"{shown}({url.rstrip('/')}/{'raw' if shown[0] == '!' else 'blob'}/HEAD/{target})"

    return re.sub(r"(?P<shown>!?\[[^\]]*\])\((?P<target>[^)\s]+)\)", absolute, text)


def published(url: str) -> dict:
    """The part of the metadata that depends on where the project is published."""
    readme = Path(__file__).with_name("README.md").read_text(encoding="utf-8")
    described = {"long_description_content_type": "text/markdown"}
    if not url:
        return {**described, "long_description": readme}
    urls = {"Source": url, "Changelog": f"{url.rstrip('/')}/blob/HEAD/CHANGELOG.md"}
    return {**described, "long_description": absolute_links(readme, url), "project_urls": urls}


if __name__ == "__main__":
    from setuptools import setup

    setup(**published(os.environ.get("PROJECT_URL", "")))
