"""What the upload brings where disparities are large: python benchmarks/upload_matters.py [--size 960x512]

Each phantom's disparity exceeds 60 px at working size. One run starts from a map within 3 px of the truth,
one from zero; both with the same levels. Prints RMSE in px and the factor between them.
"""

import argparse
import math

import numpy as np

from stereomend import refine
from stereomend.phantom import make_phantom

SEEDS = range(5)


def rmse(disparity: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean((disparity.astype(np.float64) - truth) ** 2)))


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--size", default="960x512")
    options.add_argument("--levels", type=int, default=4)
    given = options.parse_args()
    width, height = map(int, given.size.split("x"))
    levels = {"levels": given.levels}
    print(f"{'preset':10s}{'seed':>5s}{'near upload':>13s}{'refined':>9s}{'from zero':>11s}{'factor':>8s}")
    for preset in ("released", "paper", "robust"):
        factors = []
        for seed in SEEDS:
            phantom = make_phantom(seed, width, height, max_disparity=180)
            near = phantom.truth + np.random.default_rng(seed).uniform(-3, 3, phantom.truth.shape)
            pair = (phantom.pair.left, phantom.pair.right)
            helped = refine(*pair, near, preset=preset, gdr=levels).disparity
            unaided = refine(*pair, initial="zero", preset=preset, gdr=levels).disparity
            errors = [rmse(map_, phantom.truth) for map_ in (near, helped, unaided)]
            factors.append(errors[2] / errors[1])
            print(
                f"{preset:10s}{seed:5d}{errors[0]:13.2f}{errors[1]:9.2f}{errors[2]:11.2f}{factors[-1]:8.1f}"
            )
        print(f"{preset:10s} geometric mean of the factor {math.exp(np.mean(np.log(factors))):.1f}")


if __name__ == "__main__":
    main()
