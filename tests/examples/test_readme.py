"""What the README shows runs as it stands."""

import re
from pathlib import Path

import pytest

README = Path(__file__).resolve().parents[2] / "README.md"
BLOCKS = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("words", ["rod.drive(top", "@bd.damage_law"])
def test_a_block_of_the_readme(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (block,) = [block for block in BLOCKS if words in block]
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile("import pybondem as bd\n" + block, str(README), "exec"), names)
    said = capsys.readouterr().out
    drawn = [path.name for path in tmp_path.iterdir()]
    if "pull" in names:
        assert "tension.png" in drawn
        assert names["sim"].broken > 0  # type: ignore[attr-defined]
    else:
        assert "tiring.png" in drawn
        assert re.search(r"tiring: \d+ passed, \d+ skipped", said), said
