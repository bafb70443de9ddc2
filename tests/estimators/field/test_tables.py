import numpy as np
import pytest

from tactsim.estimators.field import table_field
from tactsim.estimators.field.table_field import tabulate
from tactsim.estimators.likelihoods.likelihood import TaxelSum
from tactsim.estimators.options import LikelihoodOptions


class Bump(TaxelSum):
    """Two tables that are smooth within the extent and constant outside."""

    extent = (np.array([-3.0, -2.0]), np.array([4.0, 5.0]))
    spoilt = False

    def fit(self, scan, maps):
        pass

    def evidence(self, reading):
        raise NotImplementedError

    def log_tables(self, label, xy):
        x, y = np.moveaxis(np.asarray(xy), -1, 0)
        inside = np.maximum(0, (x + 3) * (4 - x)) * np.maximum(0, (y + 2) * (5 - y))
        if self.spoilt:
            inside = inside / 0.0 if label == "b" else inside
        return np.stack([-1 - 0.1 * inside, -2 + 0.01 * inside * (1 + (label == "b"))])


@pytest.mark.parametrize(("spacing", "finest"), [((0.8, 0.8), 0.4), ((1.0, 0.3), 0.4), ((0.1, 2.0), 0.5)])
def test_nodes_hold_the_likelihood_at_their_place(spacing, finest):
    likelihood = Bump(LikelihoodOptions())
    tables = tabulate(likelihood, "ab", spacing, finest)
    phases = np.array(tables.phases[::-1])
    assert tables.step * phases == pytest.approx(spacing)
    assert (tables.step <= finest + 1e-12).all()
    nodes = tables.unit * tables.nodes
    columns, rows = np.arange(nodes.shape[3]), np.arange(nodes.shape[2])
    xy = np.stack(
        np.meshgrid(tables.origin[0] + tables.step[0] * columns, tables.origin[1] + tables.step[1] * rows), -1
    )
    for k, label in enumerate("ab"):
        there = likelihood.log_tables(label, xy)
        assert nodes[:, k] + tables.outside[:, k, None, None] == pytest.approx(there, abs=tables.unit / 2)
    for rim in (nodes[:, :, 0], nodes[:, :, -1], nodes[:, :, :, 0], nodes[:, :, :, -1]):
        assert not rim.any()
    assert tables.outside.tolist() == [[-1, -1], [-2, -2]]
    assert tables.highest == pytest.approx((nodes + tables.outside[:, :, None, None]).max(axis=(1, 2, 3)))
    assert tables.lowest == pytest.approx((nodes + tables.outside[:, :, None, None]).min(axis=(1, 2, 3)))


def test_of_many_letters_tables_are_sampled_twice_and_are_the_same(monkeypatch):
    once = tabulate(Bump(LikelihoodOptions()), "ab", (0.8, 0.8), 0.4)
    monkeypatch.setattr(table_field, "_MOST_KEPT", 0)
    twice = tabulate(Bump(LikelihoodOptions()), "ab", (0.8, 0.8), 0.4)
    assert np.array_equal(once.nodes, twice.nodes)


def test_a_likelihood_that_is_not_finite_is_refused():
    likelihood = Bump(LikelihoodOptions())
    likelihood.spoilt = True
    with pytest.raises(ValueError, match="not finite"), np.errstate(invalid="ignore", divide="ignore"):
        tabulate(likelihood, "ab", (0.8, 0.8), 0.4)


class Wide(Bump):
    """Tables that differ from the value outside only in a part of the extent, as much as the letter says."""

    extent = (np.array([-20.0, -9.0]), np.array([21.0, 12.0]))

    def log_tables(self, label, xy):
        return float(label) * (
            super().log_tables(label, xy) + [[[1]], [[2]]] if np.ndim(xy) > 1 else np.zeros(2)
        )


@pytest.mark.parametrize("labels", [("1", "900"), ("-3e5",), ("2e-9", "1e-9"), ("0",)])
def test_values_are_whole_numbers_of_a_unit_that_fits_the_largest(labels):
    tables = tabulate(Wide(LikelihoodOptions()), labels, (0.9, 1.2), 0.4)
    values = tables.unit * tables.nodes
    assert np.log2(tables.unit) == round(np.log2(tables.unit))
    largest = int(abs(tables.nodes.astype(int)).max())
    assert largest <= 32_766
    assert largest >= 16_383 or labels == ("0",)
    alone = [tabulate(Wide(LikelihoodOptions()), [label], (0.9, 1.2), 0.4) for label in labels]
    for number, one in enumerate(alone):
        rows, columns = one.nodes.shape[2:]
        begin = np.rint((one.origin - tables.origin) / tables.step).astype(int)
        assert (begin >= 0).all()
        there = values[:, number, begin[1] : begin[1] + rows, begin[0] : begin[0] + columns]
        # Rounded once, to the unit of all letters.
        assert (
            abs(there - one.unit * one.nodes[:, 0, : there.shape[1], : there.shape[2]]).max()
            <= (tables.unit + one.unit) / 2
        )
        assert np.count_nonzero(there) == np.count_nonzero(values[:, number])


def test_a_likelihood_that_differs_at_the_edge_of_its_extent_has_a_rim_of_zeros():
    class Step(Wide):
        def log_tables(self, label, xy):
            x, y = np.moveaxis(np.asarray(xy), -1, 0)
            return np.stack([np.where(x < 25, -2.0, -3.0), np.where(y < 25, -1.0, 0.0)])

    tables = tabulate(Step(LikelihoodOptions()), ["1"], (0.4, 0.4), 0.4)
    assert tables.origin == pytest.approx([-20.4, -9.4])
    for rim in (tables.nodes[:, :, 0], tables.nodes[:, :, -1], tables.nodes[..., 0], tables.nodes[..., -1]):
        assert not rim.any()
    assert (tables.unit * tables.nodes[0, 0, 1:-1, 1:-1] == 1).all()
    assert (tables.unit * tables.nodes[1, 0, 1:-1, 1:-1] == -1).all()
