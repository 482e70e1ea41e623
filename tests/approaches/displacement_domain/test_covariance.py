"""The covariance of a sum of parts, against scikit-learn's kernels and by hand."""

import numpy as np
from sklearn.gaussian_process.kernels import Matern

from crashfuse.approaches.displacement_domain.covariance import Covariance, LogNormal, Part, TrainingCovariance

ANY = LogNormal(1.0, 1.0)


def test_groups_multiply_and_parts_add() -> None:
    """Each group is scikit-learn's Matérn-5/2 over its columns, each with its own length scale."""
    x, z = np.random.default_rng(0).normal(size=(2, 10, 3))
    parts = (Part("product", ANY, (((0, ANY),), ((1, ANY),))), Part("other", ANY, (((0, ANY), (1, ANY)),)))
    ours = Covariance(parts, x, z)(np.log([1.0, 0.5, 2.0, 2.0, 0.3, 0.7]))
    first = Matern(0.5, nu=2.5)(x[:, :1], z[:, :1]) * Matern(2.0, nu=2.5)(x[:, 1:2], z[:, 1:2])
    np.testing.assert_allclose(ours, first + 4 * Matern([0.3, 0.7], nu=2.5)(x[:, :2], z[:, :2]), atol=1e-12)


def test_a_part_of_each_test_links_no_two_tests() -> None:
    x = np.array([[0.0, 1], [0.0, 1], [0.0, 2]])
    ours = Covariance((Part("own", ANY, (((0, ANY),),), same=-1),), x, x)(np.log([2.0, 1.0]))
    np.testing.assert_allclose(ours, [[4, 4, 0], [4, 4, 0], [0, 0, 4]])


def test_a_known_factor_multiplies_both_sides() -> None:
    x = np.array([[0.0, 3.0, 0], [0.0, -2.0, 0]])
    ours = Covariance((Part("ratio", ANY, (((0, ANY),),), times=1),), x, x)(np.zeros(2))
    np.testing.assert_allclose(ours, [[9, -6], [-6, 4]])


def test_the_training_covariance_is_the_lower_triangle() -> None:
    """With parts that link all rows, some rows and those of one test only."""
    rng = np.random.default_rng(1)
    x = np.column_stack([rng.normal(size=(9, 2)), np.maximum(rng.normal(size=9), 0.0), np.repeat([0.0, 1, 2], 3)])
    parts = (
        Part("all", ANY, (((0, ANY),), ((1, ANY),))),
        Part("some", ANY, (((0, ANY), (1, ANY)),), times=2),
        Part("own", ANY, (((0, ANY),),), same=-1),
    )
    logs = rng.normal(scale=0.3, size=8)
    covariance, _ = TrainingCovariance(parts, x).with_derivatives(logs)
    np.testing.assert_allclose(covariance, np.tril(Covariance(parts, x, x)(logs)), atol=1e-12)
