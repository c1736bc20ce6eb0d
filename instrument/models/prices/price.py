"""One row of the price list, with the reference for its errors and the machine on which its times were measured."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Machine:
    """Machine and date of the times."""

    cpu: str
    cores: int
    system: str
    python: str
    date: str

    @property
    def described(self) -> str:
        """The machine as text for people, without the date."""
        return f"{self.cpu}, {self.cores} cores, {self.system}, Python {self.python}"


@dataclass(frozen=True, slots=True)
class Reference:
    """The converged force ratios of one design, against which errors are measured.

    Attributes:
        fingerprint: hash of everything on which the finite-element models depend except modulus and force, and of the
            version of their code. Prices with another fingerprint are not used.
        force_ratios, uncertainties: force ratio and its uncertainty at each modulus of the list.
        how: how they were computed and checked.
        seconds: processor time of the meshes that only the reference needs [s].
    """

    design: str
    fingerprint: str
    force_ratios: tuple[float, ...]
    uncertainties: tuple[float, ...]
    how: str
    seconds: float


@dataclass(frozen=True, slots=True)
class Price:
    """Error and time of one model of one design at one refinement.

    Attributes:
        errors: for each interval between two moduli of the list the greatest distance from the reference, with the
            reference's uncertainty added. Closed forms and surfaces are compared all along the interval, the
            axisymmetric model at both ends and in the geometric middle, the solid model at both ends. None: the model
            does not answer in the whole interval, or was not asked.
        estimates: the greatest of the model's own error estimates in each interval; None: it has none.
        build_s, solve_s, evaluate_s: processor time of one answer at this refinement, in its parts [s]. A surface is
            built once; its time is wall time.
        answer_s: processor time of an answer with every mesh that its error estimate needs [s]; None: callers do not
            get such an answer.
        failure: why something is missing; empty where nothing is.
    """

    design: str
    model: str
    refinement: str
    errors: tuple[float | None, ...]
    estimates: tuple[float | None, ...]
    build_s: float | None
    solve_s: float | None
    evaluate_s: float | None
    answer_s: float | None
    failure: str = ""

    @property
    def seconds(self) -> float | None:
        """Time for one answer at this refinement alone [s]. What is built once and kept does not count."""
        if self.build_s is None or self.solve_s is None or self.evaluate_s is None:
            return self.evaluate_s
        return self.build_s + self.solve_s + self.evaluate_s

    def promise(self, intervals: slice) -> float | None:
        """Greatest error over some intervals, by reference and by the model's own estimate; None: not known."""
        errors = self.errors[intervals]
        if not errors or None in errors:
            return None
        return max(error for error in (*errors, *self.estimates[intervals]) if error is not None)
