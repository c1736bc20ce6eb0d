"""One row of the price list, with what its error was taken against, and on which machine its time was."""

from __future__ import annotations

from palpate.instrument.config import Config


class Machine(Config):
    """Where and when the times were taken."""

    cpu: str
    cores: int
    system: str
    python: str
    date: str

    @property
    def described(self) -> str:
        """All but the date, for people."""
        return f"{self.cpu}, {self.cores} cores, {self.system}, Python {self.python}"


class Reference(Config):
    """The converged force ratios of one design that errors are taken against.

    Attributes:
        fingerprint: of all that the finite-element models look at but modulus and force, and of the version of their
            code: prices of another one are not believed.
        force_ratios, uncertainties: at each modulus of the list.
        how: they were got and checked.
    """

    design: str
    fingerprint: str
    force_ratios: tuple[float, ...]
    uncertainties: tuple[float, ...]
    how: str


class Price(Config):
    """Error and time of one model of one design at one refinement.

    Attributes:
        errors: greatest distance from the reference, with the reference's uncertainty, from each modulus of the
            list to the next: of closed forms and surfaces all along, of the axisymmetric model at both ends and in the
            geometric middle, of the solid model at both ends; None where the model does not answer in all of it, or
            was not asked.
        estimates: greatest of the model's own bounds on its error, likewise; None where it has none.
        build_s, solve_s, evaluate_s: processor time that one answer takes at this refinement, taken apart [s]; a
            surface is built once, and its time is on the wall.
        answer_s: processor time that a caller of the model pays for an answer like this, with every mesh that its error
            estimate needs [s]; None where no caller gets it.
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
        """Time for one answer at this refinement alone [s]; what is built once and kept does not count."""
        if self.build_s is None or self.solve_s is None or self.evaluate_s is None:
            return self.evaluate_s
        return self.build_s + self.solve_s + self.evaluate_s

    def promise(self, intervals: slice) -> float | None:
        """Greatest error over some intervals, by reference and by own estimate; None: not all are known."""
        errors = self.errors[intervals]
        if not errors or None in errors:
            return None
        return max(error for error in (*errors, *self.estimates[intervals]) if error is not None)
