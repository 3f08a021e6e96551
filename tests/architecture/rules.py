"""The rules of the house, each a function from sources to complaints. A new module finds its place in LAYERS."""

import ast
import os
import re
import subprocess
import sys
import types
from collections.abc import Callable, Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]

# Lowest first. A module imports from layers below its own and from its own folder; neighbours in a layer do not meet.
LAYERS = (
    {"errors"},
    {"check"},
    {"portable"},
    {"ops", "schedules", "scatter"},
    {"physics"},
    {"state"},
    {"program", "bonds"},
    {"particle_bodies", "bond_answers"},
    {"bond_bodies"},
    {"engines"},
    {"packing", "theory", "neighbours", "boundaries", "output"},
    {"model"},
    {"assembly", "interface"},
    {"damping", "stability", "energies", "bond_view", "laws"},
    {"measure", "statics"},
    {"simulation"},
    {"results", "drivers"},
    {"examples"},
    {"paper"},
    {"__init__"},
    {"cli"},
    {"__main__"},
)
# Parts that may import less of the package than their layer allows: physics is pure, theory shares nothing with what it
# judges, output takes plain arrays.
INSIDE = {
    "ops": set(),
    "physics": {"ops"},
    "theory": {"errors", "check"},
    "output": {"errors", "check", "state"},
}
# Parts that may import nothing from outside but this.
OUTSIDE = {
    "ops": {"math", "typing", "collections.abc", "__future__"},
    "physics": {"typing", "collections.abc", "__future__"},
}
COMPILERS = {"numba", "numba_cuda", "llvmlite"}
COMPILED = re.compile(r"pybondem\.engines\.(cpu|cuda)(_\w+)?")
HEAVY = ("numba", "numba.cuda", "vtk", "vtkmodules", "matplotlib", "h5py", "rich")
FILE_LINES, FUNCTION_LINES = 400, 60
VAGUE = re.compile(r"managers?|factor(y|ies)|handlers?|helpers?|util(s|ity|ities)?", re.IGNORECASE)
MAGIC = {"__getattr__", "__getattribute__"}
EFFECTS = {"print", "open", "input", "exec", "eval", "setattr", "delattr"}
FORBIDDEN = {  # written so that this file passes its own rule
    "an unfinished mark": re.compile(r"\b(TO" + r"DO|FIX" + r"ME|X" + r"XX)\b"),
    "a reference that only we understand": re.compile(r"\b(issue|ticket|session)s?\s+#?\d", re.IGNORECASE),
    "a path of one machine": re.compile(r"(?<![\w./:~-])/(home|root|Users|work|tmp|mnt)/\w|\b[A-Z]:\\+Users\b"),
}
TEXTS = {".py", ".md", ".toml", ".cff", ".rst", ".txt", ".yml", ".yaml", ".cfg", ".ini", ".ipynb", ".sh"}
PLACES = ("src", "tests", "examples", "benchmarks", "docs", ".ci")

Function = ast.FunctionDef | ast.AsyncFunctionDef
Definition = Function | ast.ClassDef


class Module(NamedTuple):
    """One source file: its dotted name, its text, its tree, and the module it counts from in a relative import."""

    name: str
    text: str
    tree: ast.Module
    package: str

    @property
    def part(self) -> str:
        """What LAYERS lists: the first name below pybondem."""
        return part_of(self.name)


Package = dict[str, Module]


def part_of(name: str) -> str:
    return name.split(".")[1] if "." in name else "__init__"


def read(sources: dict[str, str]) -> Package:
    """Parse sources, given by path below src/pybondem."""
    package = {}
    for path, text in sources.items():
        parts = ["pybondem", *Path(path).with_suffix("").parts]
        folder = ".".join(parts[:-1])
        name = folder if parts[-1] == "__init__" else ".".join(parts)
        package[name] = Module(name, text, ast.parse(text, path), folder)
    return package


def read_package() -> Package:
    top = ROOT / "src" / "pybondem"
    return read({p.relative_to(top).as_posix(): p.read_text(encoding="utf-8") for p in sorted(top.rglob("*.py"))})


def imports(module: Module, package: Package) -> Iterator[tuple[str, int]]:
    """Yield (dotted name, line) of all that a module imports: at its top, in a function, by a call, for a type."""
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            up = module.package.split(".")[: module.package.count(".") + 2 - node.level]
            base = ".".join([*(up if node.level else []), *([node.module] if node.module else [])])
            for alias in node.names:
                deeper = f"{base}.{alias.name}"
                yield (deeper if deeper in package else base), node.lineno
        elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in {"__import__", "import_module"}:
            yield from ((a.value, node.lineno) for a in node.args[:1] if isinstance(a, ast.Constant))


def inner_imports(module: Module, package: Package) -> Iterator[tuple[str, int]]:
    return (found for found in imports(module, package) if found[0].split(".")[0] == "pybondem")


def outer_imports(module: Module, package: Package) -> Iterator[tuple[str, int]]:
    return (found for found in imports(module, package) if found[0].split(".")[0] != "pybondem")


def definitions(module: Module) -> Iterator[tuple[str, Definition, bool]]:
    """Yield (name, node, is it a method?) of the public classes, functions and methods, and of their __init__."""
    if any(word.startswith("_") and word != "__main__" for word in module.name.split(".")):
        return
    for node in module.tree.body:
        if isinstance(node, Definition) and not node.name.startswith("_"):
            yield f"{module.name}.{node.name}", node, False
            if isinstance(node, ast.ClassDef):
                for method in node.body:
                    if isinstance(method, Function) and (method.name == "__init__" or not method.name.startswith("_")):
                        yield f"{module.name}.{node.name}.{method.name}", method, True


def is_vague(name: str) -> bool:
    """Whether one of the words of a snake_case or CamelCase name says nothing."""
    return any(VAGUE.fullmatch(word) for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name))


# ---------------------------------------------------------------------------------------------------------- the rules
def layers_are_known(package: Package) -> list[str]:
    """Every part of the package stands in LAYERS."""
    listed = [part for layer in LAYERS for part in layer]
    unknown = sorted({m.part for m in package.values()} - set(listed))
    return [
        f"pybondem.{part} is new here: put it into LAYERS, in the lowest layer that it can live in" for part in unknown
    ]


def arrows_point_downwards(package: Package) -> list[str]:
    """A module imports only from lower layers, and from the few parts that INSIDE leaves it."""
    height = {part: k for k, layer in enumerate(LAYERS) for part in layer}
    found = []
    for m in package.values():
        for target, line in inner_imports(m, package):
            to = part_of(target)
            if to == m.part or m.part not in height:
                continue
            if height.get(to, len(LAYERS)) >= height[m.part]:
                found.append(f"{m.name}:{line} imports {target}, which is not in a layer below {m.part}")
            elif to not in INSIDE.get(m.part, {to}):
                found.append(f"{m.name}:{line} imports {target}; {m.part} imports only {sorted(INSIDE[m.part])}")
    return found


def no_import_cycle(package: Package) -> list[str]:
    """No module imports itself by way of others, be it inside a function or for a type."""
    graph = {m.name: {target for target, _ in inner_imports(m, package)} for m in package.values()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return ["import cycle: " + " -> ".join(reversed(error.args[1]))]
    return []


def physics_is_pure(package: Package) -> list[str]:
    """Physics and its words import no library, write to nothing that they were given and touch nothing outside."""
    found = []
    for m in package.values():
        if m.part not in OUTSIDE:
            continue
        allowed = OUTSIDE[m.part]
        found += [
            f"{m.name}:{line} imports {target}; {m.part} imports only {sorted(allowed)}"
            for target, line in outer_imports(m, package)
            if target not in allowed
        ]
        for node in ast.walk(m.tree):
            if isinstance(node, ast.Global | ast.Nonlocal | ast.Delete):
                found.append(f"{m.name}:{node.lineno} changes a name that is not its own")
            elif isinstance(node, ast.Attribute | ast.Subscript) and isinstance(node.ctx, ast.Store):
                found.append(f"{m.name}:{node.lineno} writes into {ast.unparse(node.value)}: return a new value")
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in EFFECTS:
                found.append(f"{m.name}:{node.lineno} calls {node.func.id}: physics is numbers in, numbers out")
    return found


def library_laws_are_a_users(package: Package) -> list[str]:
    """A published law is written as a user would write it: with words, types, a decorator and other published laws."""
    allowed = re.compile(
        r"pybondem\.(ops|physics\.types|laws\.(law|parameters|library(\.\w+)?))|typing|collections\.abc"
    )
    return [
        f"{m.name}:{line} imports {target}; a published law needs no more than a user's"
        for m in package.values()
        if m.name.startswith("pybondem.laws.library.")
        for target, line in imports(m, package)
        if not allowed.fullmatch(target)
    ]


def compilers_stay_in_their_engines(package: Package) -> list[str]:
    """Only the engines named cpu and cuda know Numba."""
    return [
        f"{m.name}:{line} imports {target}: only engines/cpu*.py and engines/cuda*.py may"
        for m in package.values()
        for target, line in outer_imports(m, package)
        if target.split(".")[0] in COMPILERS and not COMPILED.fullmatch(m.name)
    ]


def sources_are_short(package: Package) -> list[str]:
    """Files fit a sitting, functions fit a screen."""
    found = []
    for m in package.values():
        lines = len(m.text.splitlines())
        if lines > FILE_LINES:
            found.append(f"{m.name} has {lines} lines; the limit is {FILE_LINES}: split it by concept")
        for node in ast.walk(m.tree):
            if isinstance(node, Function) and (length := node.end_lineno - node.lineno + 1) > FUNCTION_LINES:
                found.append(f"{m.name}:{node.lineno} {node.name} has {length} lines; the limit is {FUNCTION_LINES}")
    return found


def public_names_are_documented(package: Package) -> list[str]:
    """Every module, public class, function and method says what it is for."""
    found = [f"{m.name} has no docstring" for m in package.values() if not ast.get_docstring(m.tree)]
    for m in package.values():
        for name, node, _ in definitions(m):
            twin = any(ast.unparse(d).endswith(("overload", ".setter", ".deleter")) for d in node.decorator_list)
            if not twin and node.name != "__init__" and not ast.get_docstring(node):
                found.append(f"{name} (line {node.lineno}) has no docstring")
    return found


def public_names_are_annotated(package: Package) -> list[str]:
    """Every public function and method states the type of each argument and of its result."""
    found = []
    for m in package.values():
        for name, node, is_method in definitions(m):
            if isinstance(node, ast.ClassDef):
                continue
            a = node.args
            given = a.posonlyargs + a.args
            bound = is_method and not any(ast.unparse(d) == "staticmethod" for d in node.decorator_list)
            given = given[1:] if bound else given
            bare = [x.arg for x in [*given, *a.kwonlyargs, a.vararg, a.kwarg] if x and not x.annotation]
            bare += ["return"] if node.returns is None and node.name != "__init__" else []
            if bare:
                found.append(f"{name} (line {node.lineno}) has no annotation for {', '.join(bare)}")
    return found


def names_are_plain(package: Package) -> list[str]:
    """No name says Manager and the like, and no attribute is made up on access."""
    found = [f"{m.name}: a vague module name" for m in package.values() if is_vague(m.name)]
    for m in package.values():
        for node in ast.walk(m.tree):
            if isinstance(node, Definition):
                name = node.name
            elif isinstance(node, ast.arg):
                name = node.arg
            elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
                name = node.id if isinstance(node, ast.Name) else node.attr
            else:
                continue
            if is_vague(name):
                found.append(f"{m.name}:{node.lineno} {name}: say what it does instead")
            if name in MAGIC:
                found.append(f"{m.name}:{node.lineno} defines {name}: write the attributes out")
    return found


def texts_are_for_strangers(texts: dict[str, str]) -> list[str]:
    """No text holds an unfinished mark, a reference to our own work or a path of our own machines."""
    return [
        f"{path}:{number} holds {what}: {match.group()}"
        for path, text in texts.items()
        for number, line in enumerate(text.splitlines(), 1)
        for what, pattern in FORBIDDEN.items()
        if (match := pattern.search(line))
    ]


def exports_are_real(module: types.ModuleType) -> list[str]:
    """__all__ exists, holds each name once, and each is there and documented."""
    names = list(getattr(module, "__all__", []))
    found = [] if names else [f"{module.__name__} has no __all__"]
    found += [f"{module.__name__}.__all__ repeats {name}" for name in sorted(set(names)) if names.count(name) > 1]
    found += [
        f"{module.__name__}.__all__ names {name}, which is not there" for name in names if not hasattr(module, name)
    ]
    present = {name: getattr(module, name) for name in names if hasattr(module, name)}
    found += [f"{module.__name__}.{name} has no docstring" for name, value in present.items() if not value.__doc__]
    return found


def heavy_imports(statement: str, path: Path) -> list[str]:
    """The heavy libraries that a fresh interpreter has loaded after a statement, with a folder on its path."""
    code = f"{statement}; import sys; print(*[name for name in {HEAVY} if name in sys.modules])"
    environment = {**os.environ, "PYTHONPATH": str(path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


RULES: list[Callable[[Package], list[str]]] = [
    layers_are_known,
    arrows_point_downwards,
    no_import_cycle,
    physics_is_pure,
    library_laws_are_a_users,
    compilers_stay_in_their_engines,
    sources_are_short,
    public_names_are_documented,
    public_names_are_annotated,
    names_are_plain,
]
