"""A simulation and its records: names, models that change, selections of other models."""

import numpy as np
import pytest

import pybondem as bd


def pulled_row(count: int = 5) -> tuple[bd.Model, bd.Selection, bd.Selection]:
    model = bd.Model(bd.packing.line(count, spacing=1e-2, diameter=1e-2), density=2500.0)
    model.bond(model.touching(), bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0)))
    low, high = model.select([0]), model.select([count - 1])
    model.fix(low)
    model.drive(high, vx=0.01)
    return model, low, high


def test_records_without_a_name_get_one_each(tmp_path):
    model, low, high = pulled_row()
    sim = bd.Simulation(model, engine="reference")
    force = sim.record(10, force=bd.reaction(low, "x"))
    with bd.Results(sim, "two", folder=tmp_path / "out", quiet=True):
        strain = sim.record(20, strain=bd.strain(low, high, "x"))  # made after the folder
        sim.run(40, quiet=True)
    assert (force.name, strain.name) == ("history", "history-2")
    for record, rows in ((force, 5), (strain, 3)):
        table = np.genfromtxt(tmp_path / "out" / f"{record.name}.csv", delimiter=",", skip_header=1)
        assert table.shape == (rows, 2)
        assert np.array_equal(table[:, 1], next(c.values for n, c in record.columns.items() if n != "time"))


@pytest.mark.parametrize("name", ["history", "a/b", ""])
def test_a_record_name_that_is_taken_or_no_file_name_is_refused(name):
    model, low, _ = pulled_row()
    sim = bd.Simulation(model, engine="reference")
    sim.record(10, force=bd.reaction(low, "x"))
    with pytest.raises(bd.InputError, match="a record cannot be named"):
        sim.record(10, name=name, force=bd.reaction(low, "x"))


@pytest.mark.parametrize("name", ["measures", "columns", "take", "plot", "time"])
def test_a_column_cannot_take_the_place_of_the_record(name):
    sim = bd.Simulation(pulled_row()[0], engine="reference")
    with pytest.raises(bd.InputError, match="reserved column"):
        sim.record(10, **{name: bd.broken()})


def test_a_column_that_is_not_there_is_named_with_the_nearest():
    model, low, _ = pulled_row()
    record = bd.Simulation(model, engine="reference").record(10, force=bd.reaction(low, "x"))
    with pytest.raises(bd.InputError, match=r"no column 'forse' .did you mean 'force'"):
        record["forse"]


def test_a_selection_of_another_model_measures_nothing():
    model, low, _ = pulled_row()
    other = pulled_row(9)[2]
    sim = bd.Simulation(model, engine="reference")
    for measure in (bd.reaction(other, "x"), bd.displacement(other, "y"), bd.strain(low, other, "x")):
        with pytest.raises(bd.SelectionError, match="of another model"):
            sim.record(10, m=measure)
    for combine in (lambda: low | other, lambda: low & other, lambda: low - other, lambda: low | 3):
        with pytest.raises(bd.SelectionError, match="same model"):
            combine()


@pytest.mark.parametrize("change", ["fix", "bond", "add"])
def test_a_model_that_was_changed_needs_a_new_simulation(change):
    model, _, _ = pulled_row()
    sim = bd.Simulation(model, engine="reference")
    if change == "fix":
        model.fix(model.select([2]), "y")
    elif change == "bond":
        with pytest.warns(UserWarning, match="times as long"):
            model.bond([[0, 2]], bd.Bond(bd.springs(1e6, 0.0)))
    else:
        model.add(bd.packing.line(1, spacing=1.0, start=(1.0, 0.0, 0.0), diameter=1e-2), name="more", density=1.0)
    with pytest.raises(bd.InputError, match="changed after its Simulation"):
        sim.run(10, quiet=True)


def test_interface_fields_and_bond_forces_come_in_the_users_order():
    """Bonds given back to front answer with the opposite force on their first end."""
    model, _, _ = pulled_row(3)
    forces = []
    for pairs in ([[0, 1], [1, 2]], [[2, 1], [0, 1]]):
        row = bd.Model(bd.packing.Particles(model.x, model.radius), density=2500.0)
        bonds = row.bond(pairs, bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0)))
        sim = bd.Simulation(row, engine="reference")
        with sim.edit("x") as x:
            x[2, 0] += 1e-6
        forces.append(sim.bonds(bonds).force)
    assert forces[0][1, 0] > 0.0
    assert np.array_equal(forces[1][0], -forces[0][1])
    assert np.array_equal(forces[1][1], forces[0][0])
