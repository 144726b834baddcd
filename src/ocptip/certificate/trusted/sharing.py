"""Contacts hold the base within a tolerance: by forces that follow the wrench by one linear rule per row.

A rule shares a change of the wrench among the contacts in proportion to given weights. Every facet of a
contact's friction cone is then a functional of the wrench, and so is a moment about a tipping axis; its
minimum comes from `within`. Any forces and any weights prove a bound. Plain data and NumPy only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ocptip.certificate.trusted.contacts import Contacts, patterns
from ocptip.certificate.trusted.forms import U, known
from ocptip.certificate.trusted.late import Late, Rows
from ocptip.certificate.trusted.terms import Terms
from ocptip.certificate.trusted.twists import FrictionLimits, Twists
from ocptip.certificate.trusted.within import Within

FACETS = (8, 48)  # of cones: few first, more where these are not enough
_REGULAR = 1e-15


class Sharing:
    """The claims within an uncertainty, row by row.

    Args:
        model, motion, tolerance, bounds: of a certificate; of the bounds GN_worst_case and GT_worst_case.
        carried: one of the model's objects, whose contacts they are; None: those of the base.

    Attributes:
        late: what the joints may be doing.
        contacts: with the minimum friction, and what is asked of them.
    """

    def __init__(
        self,
        model: Mapping[str, Any],
        motion: Mapping[str, Any],
        tolerance: Mapping[str, Any],
        bounds: Mapping[str, float],
        carried: Mapping[str, Any] | None = None,
    ) -> None:
        self.contacts = Contacts(carried or model, bounds["GN_worst_case"], 1 - tolerance["friction"])
        self._share, self._within = bounds["GT_worst_case"], Within(model, tolerance, motion, carried)
        self.late = Late(motion, tolerance["delay"] * (1 + tolerance["speed"]), tolerance["overshoot"])

    def terms(self, rows: Rows) -> Terms:
        """The terms of the wrench on the base."""
        return self._within.terms(rows)

    @np.errstate(invalid="ignore", over="ignore", divide="ignore")
    def margins(self, terms: Terms, forces: np.ndarray, weights: np.ndarray) -> dict[str, np.ndarray]:
        """By how much both claims are kept, (R,) each: proved where >= 0.

        Args:
            terms: of R rows.
            forces: (2, 1 + couples, contacts, 3, R) for the nominal model, at both ends of their intervals;
                what they miss is shared by the rule.
            weights: (contacts, 2, R) of the rule, normal and tangential. A contact without any, and without
                force, carries none.
        """
        contacts = self.contacts
        if contacts.flat:
            left = (self.moments(terms) - contacts.needed) / contacts.unit
        else:
            left = np.full(terms.size.shape[1], np.inf)
            for k, couple in enumerate(contacts.couples):
                left = np.minimum(left, self.held(terms, forces[:, 1 + k], weights, 1.0, couple))
        held = self.held(terms, forces[:, 0], weights, self._share)
        return {"contacts within tolerance": known(held), "tip-over within tolerance": known(left)}

    def moments(self, terms: Terms) -> np.ndarray:
        """Lower bounds (R,), N m, of all moments about tipping axes, of contacts on one plane; close ones of
        what is less than is needed."""
        count = terms.size.shape[1]
        axes = np.broadcast_to(self.contacts.axes[:, :, None], (*self.contacts.axes.shape, count))
        blurred = self.contacts.blurred @ terms.size
        added = self.contacts.added[:, None] - self.contacts.needed - blurred
        least = self._within.least(terms, axes, np.broadcast_to(added, (2, *added.shape)))
        return np.min(least, axis=0, initial=np.inf) + self.contacts.needed

    def held(
        self,
        terms: Terms,
        forces: np.ndarray,
        weights: np.ndarray,
        share: float,
        couple: np.ndarray | None = None,
        patient: bool = True,
    ) -> np.ndarray:
        """(R,): how far forces that hold wrench and couple are inside a share of their sets, per weight."""
        if self.contacts.flat:
            return self._held_on_a_plane(terms, forces, weights, share, patient)
        return np.min(self.rooms(terms, forces, weights, share, couple), axis=0)

    def rooms(
        self,
        terms: Terms,
        forces: np.ndarray,
        weights: np.ndarray,
        share: float,
        couple: np.ndarray | None = None,
        facets: Sequence[int] = FACETS,
    ) -> np.ndarray:
        """The same contact by contact, (contacts, R); cones by as many facets as are needed of these."""
        slack = np.full((self.contacts.count, terms.size.shape[1]), np.inf)
        couple = np.zeros(6) if couple is None else couple
        for pattern, here in patterns(np.any(forces != 0, axis=(0, 2)) | np.any(weights != 0, axis=1)):
            rule, some = Rule(self.contacts, pattern, weights[pattern][..., here]), terms.some(here)
            ends = forces[:, pattern][..., here].reshape(2, -1, len(here))
            constant, error = rule.constant(ends, couple, some.size)
            for k, contact in enumerate(np.flatnonzero(pattern)):
                block, pieces = slice(3 * k, 3 * k + 3), self.contacts.sets[contact]
                place = rule.rule[:, block], constant[:, block], error[block]
                cones = facets if self.contacts.bears[3 * contact + 1] else ()  # else nothing is tangential
                by_piece = [self._inside(some, place, piece, share, cones) for piece in pieces]
                slack[contact, here] = np.max(by_piece, axis=0)
            if not self.contacts.idle(pattern):
                slack[:, here] = -np.inf
        return slack

    def _held_on_a_plane(
        self, terms: Terms, forces: np.ndarray, weights: np.ndarray, share: float, patient: bool
    ) -> np.ndarray:
        """(R,): how far normal forces by the rule are inside their sets, and friction of them is enough."""
        slack = np.full(terms.size.shape[1], np.inf)
        for pattern, here in patterns(np.any(forces != 0, axis=(0, 2)) | np.any(weights != 0, axis=1)):
            if not self.contacts.idle(pattern):
                slack[here] = -np.inf
                continue
            rule, some = Rule(self.contacts, pattern, weights[pattern][..., here]), terms.some(here)
            ends = forces[:, pattern][..., here].reshape(2, -1, len(here))
            normal, error = (part[..., ::3, :] for part in rule.constant(ends, np.zeros(6), some.size))
            radius, slope = np.zeros((2, len(here), len(normal[0])))
            for k, contact in enumerate(np.flatnonzero(pattern)):
                place = rule.rule[:, 3 * k : 3 * k + 1], normal[:, k : k + 1], error[k : k + 1]
                pieces = self.contacts.sets[contact]
                by_piece = np.array([self._pressed(some, place, piece) for piece in pieces])
                slack[here] = np.minimum(slack[here], np.max(by_piece, axis=0))
                radius[:, k], slope[:, k] = np.array(pieces)[np.argmax(by_piece, axis=0), 2:].T * share
            going = np.flatnonzero(slack[here] >= 0)
            if not len(going):
                continue
            kept_terms, h = some.some(going), rule.rule[going, ::3]
            normal, error, slope = np.swapaxes(normal, 1, 2)[:, going], error.T[going], slope[going]
            error = (
                error
                + 8 * U * (np.abs(h) @ kept_terms.size.T[:, :, None])[..., 0]
                + 8 * U * np.abs(normal).max(axis=0)
            )
            limits = FrictionLimits(
                -slope[:, :, None] * h,
                radius[going] + slope * normal,
                np.abs(slope) * error + 8 * U * np.abs(radius[going]),
            )
            rough = self.contacts.bears[1::3]  # the others have no limits, and bear nothing
            if not np.any(pattern & rough):
                slack[here[going]] = -np.inf
                continue
            kept, columns = rough[pattern], np.repeat(pattern & rough, 3)
            limits = FrictionLimits(limits.rule[:, kept], limits.constant[..., kept], limits.error[:, kept])
            grasp, rounded = self.contacts.grasp[:, columns], self.contacts.rounded[:, columns]
            twists = Twists(grasp, rounded, kept_terms.centre, kept_terms.half, limits)
            result = twists.slack(
                lambda rows, h, constant, closely, kept_terms=kept_terms: self._within.least(
                    kept_terms.some(rows), h, constant, closely
                ),
                patient,
            )
            slack[here[going]] = np.minimum(slack[here[going]], result / self.contacts.scale)
        return slack

    def _pressed(
        self,
        terms: Terms,
        place: tuple[np.ndarray, np.ndarray, np.ndarray],
        piece: tuple[float, float, float, float],
    ) -> np.ndarray:
        """(R,): of a normal force and one piece of its set; the friction is not negative.

        Any wrench of the boxes is tried first.
        """
        low, high, radius, slope = piece
        if slope == 0 and not radius >= 0:
            return np.full(terms.size.shape[1], -np.inf)
        rows = [(np.array([1.0]), -low), (np.array([-1.0]), high)]
        rows += [(np.array([slope]), radius)] if slope != 0 else []
        rows = [row for row in rows if np.isfinite(row[1])]
        slack = self.least(terms, place, rows, in_box=True)
        if len(left := np.flatnonzero(~(slack >= 0))):
            chosen = place[0][left], place[1][..., left], place[2][..., left]
            slack[left] = self.least(terms.some(left), chosen, rows)
        return slack

    def _inside(
        self,
        terms: Terms,
        place: tuple[np.ndarray, np.ndarray, np.ndarray],
        piece: tuple[float, float, float, float],
        share: float,
        facets: Sequence[int],
    ) -> np.ndarray:
        """(R,): of one contact and one piece of its set."""
        low, high, radius, slope = piece
        normal = [(np.array([1.0, 0.0, 0.0]), -low), (np.array([-1.0, 0.0, 0.0]), high)]
        slack = self.least(terms, place, [row for row in normal if np.isfinite(row[1])])
        rows = np.flatnonzero(slack >= 0)
        for count in facets:
            if not len(rows):
                break
            angle = 2 * np.pi * (np.arange(count) + 0.5) / count
            around = np.column_stack([np.zeros(count), np.cos(angle), np.sin(angle)]) / np.cos(np.pi / count)
            cone = [(np.array([share * slope, 0.0, 0.0]) - side, share * radius) for side in around]
            chosen = place[0][rows], place[1][..., rows], place[2][..., rows]
            result = self.least(terms.some(rows), chosen, cone)
            done = (result >= 0) | (count == facets[-1])
            slack[rows[done]] = np.minimum(slack[rows], result)[done]
            rows = rows[~done]
        return slack

    def least(
        self,
        terms: Terms,
        place: tuple[np.ndarray, np.ndarray, np.ndarray],
        rows: list[tuple[np.ndarray, float]],
        in_box: bool = False,
    ) -> np.ndarray:
        """Minimum of row . force + number, per weight, (R,); or of any wrench of the boxes."""
        rule, constant, error = place  # (R, 3, 6), (2, 3, R), (3, R)
        if not rows:
            return np.full(len(rule), np.inf)
        b, added = np.array([row for row, _ in rows]), np.array([number for _, number in rows])
        h = -np.einsum("ac,rci->air", b, rule)
        ends = np.einsum("ac,ecr->ear", b, constant) + added[:, None]
        least = (terms.in_box(h, ends) if in_box else self._within.least(terms, h, ends)) - np.abs(b) @ error
        return np.min(least, axis=0) / self.contacts.scale


class Rule:
    """Shares wrenches among contacts by weights: f = f_0 - F (G f_0 + w), and what that misses.

    What contacts may not have stays zero.

    Attributes:
        rule: F, (R, 3 contacts, 6).
    """

    def __init__(self, contacts: Contacts, pattern: np.ndarray, weights: np.ndarray) -> None:
        columns, scale = np.repeat(pattern, 3), contacts.scaling
        self._G = contacts.grasp[:, columns]
        self._blur = contacts.rounded[:, columns] + U * self._G.shape[1] * np.abs(self._G)
        self._correction, self._defect = contacts.inverse(columns)
        self._bears = contacts.bears[columns][:, None]
        share = np.repeat(np.maximum(weights, 0.0), (1, 2), axis=1).reshape(-1, weights.shape[2])
        share = (share * self._bears).T  # (R, 3 n)
        G = scale[:, None] * self._G
        A = np.einsum("ia,ra,ja->rij", G, share, G)
        A += (_REGULAR * np.trace(A, axis1=1, axis2=2) + 1e-200)[:, None, None] * np.eye(6)
        self.rule = share[:, :, None] * (G.T @ np.linalg.inv(A)) * scale
        self._left = np.abs(np.eye(6) - self._G @ self.rule) + self._blur @ np.abs(self.rule)

    def constant(
        self, ends: np.ndarray, couple: np.ndarray, size: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The part of forces (2, 3 contacts, R) at both ends that the wrench does not change, (2, 3 contacts,
        R), with a couple, and a bound of errors (3 contacts, R).
        """
        ends = ends * self._bears
        largest = np.max(np.abs(ends), axis=0)
        missed = np.einsum("ic,ecr->eir", self._G, ends) + couple[:, None]
        shared = np.einsum("rci,eir->ecr", self.rule, missed)
        whole = np.abs(self._G) @ largest + np.abs(couple)[:, None] + size
        left = np.max(np.einsum("rij,jr->ir", self._left, whole), axis=0)  # of the wrench, corrected again
        error = np.abs(self._correction).sum(axis=1)[:, None] * left * (1 + self._defect)
        rounded = self._blur @ largest + U * np.abs(couple)[:, None] + U * size  # and of row . rule . wrench
        error = error + np.einsum("rci,ir->cr", np.abs(self.rule), rounded)
        return ends - shared, error * (1 + U) + U * largest
