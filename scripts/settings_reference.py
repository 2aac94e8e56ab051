"""Write `configs/default.yaml` and `docs/reference/settings.md` from the declarations in `swarmer/config.py`.

python scripts/settings_reference.py            writes both
python scripts/settings_reference.py --check    exit status 1 if one is not up to date
"""

from __future__ import annotations

import sys
import textwrap
from itertools import groupby
from pathlib import Path

from swarmer.config import RunConfig, setting_facts
from swarmer.settings import UNIT_WORDS, Setting, as_yaml

ROOT = Path(__file__).resolve().parent.parent
MADE_BY = "made by scripts/settings_reference.py from swarmer/config.py; do not edit"


def main(arguments: list[str]) -> int:
    """Write what is out of date, or only name it after --check."""
    stale = [(path, text) for path, text in outputs() if not path.exists() or path.read_text("utf-8") != text]
    for path, text in stale:
        print(f"{path.relative_to(ROOT)}: {'not up to date' if '--check' in arguments else 'written'}")
        if "--check" not in arguments:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    return 1 if stale and "--check" in arguments else 0


def outputs() -> list[tuple[Path, str]]:
    """The files and what they should hold."""
    return [
        (ROOT / "configs" / "default.yaml", default_yaml()),
        (ROOT / "docs" / "reference" / "settings.md", settings_page()),
    ]


def group_of(setting: Setting) -> str:
    """The part before the dot, or nothing."""
    return setting.name.rpartition(".")[0]


def group_doc(group: str) -> str:
    """The first line of the group's docstring."""
    return (RunConfig.model_fields[group].annotation.__doc__ or "").splitlines()[0]


def default_yaml() -> str:
    """Every setting with its default, its help and its range as a comment."""
    lines = [f"# Every setting and its default. {MADE_BY.capitalize()}."]
    for group, settings in groupby(setting_facts(), group_of):
        indent = "  " if group else ""
        lines += ["", f"{group}:  # {group_doc(group)}"] if group else [""]
        for setting in settings:
            comment = f"{setting.explained}; {setting.allowed.rpartition(' (default ')[0]}"
            if setting.default is None:
                comment += f" ({setting.none})"
            wrapped = textwrap.wrap(comment, 105, break_long_words=False, break_on_hyphens=False)
            lines += [f"{indent}# {line}" for line in wrapped]
            lines.append(f"{indent}{setting.name.rpartition('.')[2]}: {as_yaml(setting.default)}")
    return "\n".join(lines) + "\n"


def settings_page() -> str:
    """The reference as Markdown: one table for each group."""
    lines = [
        f"<!-- {MADE_BY} -->",
        "# Settings",
        "",
        "In a YAML file, after `--set NAME=VALUE`, or as the option of `swarmer-run` that says so. Later ones win:",
        "preset or file, then `--set`, then options. `--config` takes a path or a preset's name: `default`, `paper`",
        "(every rule as the paper has it) or `authors_code` (as the authors' program has it). A file may begin",
        "with `extends: NAME_OR_PATH` and then holds only what differs.",
    ]
    for group, settings in groupby(setting_facts(), group_of):
        lines += ["", f"## {group or 'The run'}", ""]
        lines += [group_doc(group), ""] if group else []
        lines += ["| setting | default | allowed | what it is |", "|---|---|---|---|"]
        lines += [row(setting) for setting in settings]
    return "\n".join(lines) + "\n"


def row(setting: Setting) -> str:
    """One line of a table."""
    allowed = setting.range
    if setting.kind in ("number", "whole"):
        unit = f" {UNIT_WORDS[setting.unit]}" if setting.unit not in ("", "p") else ""
        kind = {"whole": "whole number, "}.get(setting.kind, "probability, " if setting.unit == "p" else "")
        allowed = kind + setting.span + unit + setting.besides
    if setting.none:
        allowed += f", or null: {setting.none}"
    return f"| `{setting.name}` | `{as_yaml(setting.default)}` | {allowed} | {setting.explained} |"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
