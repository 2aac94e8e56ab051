"""What the paper says in its figures and tables (SwarMer, arXiv 2312.04571), as data.

A band is what the mean over 20 seeds is accepted within, where the paper's value is a single run of another program; it
was set with the results of two independent re-implementations in view. Where the paper shows a curve and no number, its
words stand for it, and the band says what they mean.
"""

from __future__ import annotations

from typing import NamedTuple


class Claim(NamedTuple):
    """A number: `quantity` of the runs of an experiment in which the settings of `where` hold."""

    figure: str
    experiment: str
    where: dict[str, str]
    quantity: str  # of paper.quantities
    words: str
    paper: float | str
    band: tuple[float, float]
    why: str = ""  # what is known of a disagreement


class Order(NamedTuple):
    """An order, seed by seed: `quantity` is more than `factor` times as large with `more` as with `less`."""

    figure: str
    experiment: str
    where: dict[str, str]
    less: dict[str, str]
    more: dict[str, str]
    quantity: str
    words: str
    factor: float = 1.0
    why: str = ""


def _number(
    figure: str, experiment: str, quantity: str, words: str, *entries: tuple[object, ...]
) -> list[Claim]:
    """Entries: (where, paper's value, band, why)."""
    return [
        Claim(figure, experiment, entry[0], quantity, words, *entry[1:])  # type: ignore[arg-type]
        for entry in entries
    ]


DRAGON, HAT, SKATEBOARD = {"shape": "dragon"}, {"shape": "hat"}, {"shape": "skateboard"}
M2, ANY = {"m": "2"}, {"m": "inf"}
SHAPES_2D = [{"shape": name} for name in ("butterfly", "cat", "teapot")]
SWARMER, DR = {"technique": "signal_strength"}, {"technique": "dead_reckoning"}
TRI, TRILA = {"technique": "triangulation"}, {"technique": "trilateration"}
PM = {"technique": "physical_movement"}
LARGEST_ANCHORS, SMALLEST_ANCHORS = {"rounds.anchor": "largest"}, {"rounds.anchor": "smallest"}
SELDOM, OFTEN = {"lambda_ms": "1000"}, {"lambda_ms": "50"}


def eps(*degrees: int) -> list[dict[str, str]]:
    return [{"epsilon_deg": str(one)} for one in degrees]


def quarter(value: float) -> tuple[float, float]:
    return (0.75 * value, 1.25 * value)


TEXT_ERROR = "the text's larger errors of flights"
RACECAR = (
    "four formations, as in the paper, but of 7 or 8 rounds where the paper's first took 6; with FIDs in the order "
    "of the shape (rounds.fids: shape) formations take 5 or 6, and it needs six of them: 31 rounds"
)
LARGEST = "the largest swarm is the least flying on both shapes"
LEASES = "leases expire where the machine is late, with 1,727 processes on it; in virtual time nobody is"
THAWS = (
    "a formation is a localization of all FLSs but one, so there is about one thaw for each; in the paper's table "
    "an FLS must obey, or count, every THAW dozens of times"
)
FIGURE_26 = "the paper's multiples of 10 are formations of 10 rounds, as M 2 has them"

SMALL: list[Claim | Order] = [
    *(Order("1", "fig01_2d_shapes", shape, SWARMER, DR, "hd", "HD: SwarMer < dead reckoning alone")
      for shape in SHAPES_2D),
    *(Order("1", "fig01_2d_shapes", shape, SWARMER, bad, "hd", f"HD: SwarMer < {bad['technique']}")
      for shape in SHAPES_2D for bad in (TRI, TRILA)),
    Order("5-7", "fig05_07_ss_pm_94", {}, SWARMER, PM, "flown",
          "cells flown: Physical Movement > 4 × Signal Strength", 4.0),
    Order("5-7", "fig05_07_ss_pm_94", {}, SWARMER, PM, "hd", "HD at the end: Signal Strength < Physical Movement"),
    Order("8-10", "fig08_10_ss_pm_1008", {}, SWARMER, PM, "flown", "cells flown: Physical Movement > Signal Strength"),
    Order("8-10", "fig08_10_ss_pm_1008", {}, SWARMER, PM, "hd", "HD at the end: Signal Strength < Physical Movement"),
    *_number("13", "fig13_localizing", "first_swarm", "round of the first single swarm",
             (DRAGON, 5, (4, 7)), (HAT, 4, (4, 7)), (SKATEBOARD, 5, (4, 7))),
    *_number("13", "fig13_localizing", "thaws", "thaws before the end",
             (DRAGON, 3, (2, 5)), (HAT, 3, (2, 5)), (SKATEBOARD, 2, (2, 5))),
    *_number("14", "fig14_18_epsilon", "rounds", "rounds to HD < 0.09",
             (eps(1)[0], 5, (5, 10)), (eps(3)[0], "between", (5, 22)), (eps(5)[0], 21, (14, 22))),
    Order("18", "fig14_18_epsilon", {}, *eps(1, 5), "flown_after", "cells flown grow with ε"),  # type: ignore[arg-type]
    Claim("19", "fig19_merged", {}, "group_mean", "swarms per group in round 1, mean", 3.5, (3, 4)),
    Claim("19", "fig19_merged", {}, "group_max", "swarms per group, most", 6, (6, 6),
          "the paper's is of one run; ours is 6 or 7 by the seed"),
    *_number("4.2.1", "table1_m", "rounds", "rounds to HD < 0.09",
             (DRAGON | ANY, 21, (14, 22)), (DRAGON | M2, 30, (30, 40)),
             (SKATEBOARD | ANY, 16, (15, 21)), (SKATEBOARD | M2, 33, (33, 44))),
    *(claim for shape, m, localizing, swarm in (
        (DRAGON, M2, 1356, 7542), (DRAGON, ANY, 1478, 4233), (HAT, M2, 3352, 19187), (HAT, ANY, 3670, 9184),
        (SKATEBOARD, M2, 2733, 17538), (SKATEBOARD, ANY, 2897, 10411),
    ) for claim in (
        Claim("Table 1", "table1_m", shape | m, "localizing", "cells flown by localizing FLSs", localizing,
              quarter(localizing)),
        Claim("Table 1", "table1_m", shape | m, "swarm", "cells flown by their swarms", swarm,
              quarter(swarm)),
    )),
    *_number("20", "fig20_scale", "first_swarm", "round of the first single swarm",
             ({"shape": "racecar"}, 6, (6, 8)), ({"shape": "statue"}, 6, (6, 8))),
    *_number("20", "fig20_scale", "rounds", "rounds to HD < 0.09",
             (DRAGON, 21, (14, 22)), ({"shape": "racecar"}, 24, (20, 30), RACECAR),
             ({"shape": "statue"}, 37, (30, 44))),
    *(Claim("beyond 20", "scale_million", {}, "first_swarm", "round of the first single swarm, 50,000 FLSs",
            "grows slowly", (6, 12)),),
    Order("4.2.2", "anchors", DRAGON, LARGEST_ANCHORS, SMALLEST_ANCHORS, "flown",
          "cells flown, dragon: least with the largest swarm as the anchor"),
    Order("4.2.2", "anchors", SKATEBOARD, SMALLEST_ANCHORS, LARGEST_ANCHORS, "flown",
          "cells flown, skateboard: least with the smallest swarm as the anchor", why=LARGEST),
    Claim("21", "fig21_random", {}, "rounds", "rounds to HD < 0.09 from random places", 26, (20, 30)),
    Claim("21", "fig21_random", {}, "shift", "cells by which the shape ends shifted", "shifted", (1, 1e9)),
    *(Order("25", "fig25_yardsticks_94", e, SWARMER, bad, "hd", f"HD: SwarMer < {bad['technique']}")
      for e in eps(1, 3, 5) for bad in (DR, TRI, TRILA)),
    Order("25", "fig25_yardsticks_94", eps(1)[0], DR, TRILA, "hd", "HD: dead reckoning alone < trilateration"),
    Order("26", "fig26_yardsticks_1008", eps(1)[0], DR, TRILA, "hd", "HD: dead reckoning alone < trilateration"),
    Order("26", "fig26_yardsticks_1008", eps(1)[0], DR, TRI, "hd", "HD: dead reckoning alone < triangulation"),
    *_number("26", "fig26_yardsticks_1008", "rounds", "SwarMer's rounds, M 2",
             *((SWARMER | M2 | e, paper, band, FIGURE_26) for e, paper, band in zip(
                 eps(1, 3, 5), (20, 30, 40), ((10, 20), (20, 30), (30, 40)), strict=True))),
]  # fmt: skip
"""What the rounds simulator made."""

EMULATOR: list[Claim | Order] = [
    *(Claim("27", "fig27_lambda_chess", {"lambda_ms": name}, "to_0.1", "seconds to HD < 0.1", "converges", (0, 60))
      for name in ("50", "200", "500", "1500")),
    *(Claim("28", "fig28_lambda_skateboard", {"lambda_ms": name}, "to_0.1", "seconds to HD < 0.1", "converges", (0, 60))
      for name in ("50", "500", "1500")),
    Claim("29", "fig29_30_shapes", DRAGON, "to_0.01", "seconds to HD < 0.01", "tens", (10, 100)),
    *(Claim("31", "fig31_loss", where, "to_1", "seconds to HD < 1", "the first seconds", (0, 30))
      for where in (
          {"radio.loss_sender": "null", "radio.loss_receiver": "0"},
          {"radio.loss_sender": "null", "radio.loss_receiver": "0.1"},
          {"radio.loss_sender": "0.1", "radio.loss_receiver": "0.1"},
      )),
    *(Claim("32", "fig32_failures_chess", {"failure.rate": rate}, "hd_least", "least HD", "falls again", (0, 0.5))
      for rate in ("0.0001", "0.001")),
    Claim("33", "fig33_failures_skateboard", {"failure.rate": "0.0001"}, "hd_least", "least HD",
          "falls again", (0, 0.5)),
    Order("33", "fig33_failures_skateboard", {}, {"failure.rate": "0.0001"}, {"failure.rate": "0.1"}, "hd_median",
          "median HD over time grows with the failures"),
    Order("Table 2", "table2_metrics", {}, SELDOM, OFTEN, "bytes", "bytes sent: more at λ 50 than at λ 1000"),
    Order("Table 2", "table2_metrics", {}, SELDOM, OFTEN, "localizations",
          "localizations: more at λ 50 than at λ 1000"),
    *(Claim("Table 2", "table2_metrics", where, "distance", "cells flown by an FLS, deployment included", value,
            quarter(value))
      for where, value in ((OFTEN, 70.4), (SELDOM, 75.2))),
    *(Claim("Table 2", "table2_metrics", where, "thaws_per_localization", "thaws of FLSs for each localization",
            value, quarter(value), THAWS) for where, value in ((OFTEN, 36.0), (SELDOM, 31.5))),
    *(Claim("Table 2", "table2_metrics", where, "leases_expired", "leases that expire, %", value,
            quarter(value), LEASES)
      for where, value in ((OFTEN, 11.03), (SELDOM, 5.16))),
    *(Claim("6", "speed", {"flight.speed_m_s": v}, "to_0.1", "seconds to HD < 0.1", "as at any speed", (0, 60))
      for v in ("3", "10")),
]  # fmt: skip
"""What the emulator made; here by the paper's rules in virtual time."""

CLAIMS = [*SMALL, *EMULATOR]

# The quick version: seeds, the values of the grid that it has, settings in place of the file's.
QUICK: dict[str, tuple[str, dict[str, tuple[str, ...]], tuple[str, ...]]] = {
    **dict.fromkeys(("fig01_2d_shapes", "fig05_07_ss_pm_94", "fig08_10_ss_pm_1008"), ("6", {}, ())),
    **dict.fromkeys(("fig13_localizing", "fig14_18_epsilon", "fig19_merged", "fig21_random"), ("6", {}, ())),
    "table1_m": ("4", {}, ()),
    "fig20_scale": ("2", {}, ()),
    "fig25_yardsticks_94": ("6", {}, ()),
    "fig26_yardsticks_1008": ("3", {}, ()),
    "fig27_lambda_chess": ("2", {"lambda_ms": ("50", "200", "500", "1500")}, ()),
    "fig28_lambda_skateboard": ("1", {"lambda_ms": ("50", "500", "1500")}, ("points=200", "duration_s=60")),
    "fig33_failures_skateboard": ("2", {"failure.rate": ("0.0001", "0.1")}, ("points=200", "duration_s=40")),
    "table2_metrics": ("3", {"lambda_ms": ("50", "1000")}, ("points=100", "duration_s=10")),
    "anchors": ("10", {"rounds.anchor": ("largest", "smallest")}, ()),
    "scale_million": ("1", {}, ("points=50000",)),
    "fig29_30_shapes": ("1", {"shape": ("dragon",)}, ()),
    "fig31_loss": ("1", {"radio.loss_receiver": ("0", "0.1")}, ("shape=dragon", "duration_s=30")),
    "fig32_failures_chess": ("2", {"failure.rate": ("0.0001", "0.001")}, ("duration_s=60",)),
    "speed": ("1", {"flight.speed_m_s": ("3", "10")}, ()),
}
TEXT = ("fig13_localizing", "fig14_18_epsilon", "table1_m", "fig21_random")
"""Experiments that are made by the rules of the paper's text, too, beside those of the authors' program."""
