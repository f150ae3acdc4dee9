"""Numbers to meet: of the paper, and of an independent implementation in NumPy and C."""

from backsight_studies.beam.tuning import NO_CARRYOVER, READING_1, READING_3

PAPER_FREQUENCIES = {
    0.0: (8.76, 54.88, 153.66),
    -3.3: (8.47, 53.05, 148.54),
    -6.7: (8.17, 51.22, 143.42),
    -10.0: (7.88, 49.39, 138.30),
}
"""Table 3 [Hz]."""

FREQUENCIES = {
    0.0: (8.756804352334, 54.877956123677, 153.659866196738),
    -3.3: (8.464910873922, 53.048690919555, 148.537870656847),
    -6.7: (8.173017395511, 51.219425715432, 143.415876),
    -10.0: (7.8811239171, 49.390160511309, 138.293879577064),
}
"""The same with all digits [Hz]."""

OBSERVABLE = 9
"""Largest number of states that is observable, Fig. 5."""

ZEROS = (-0.997251019358, -0.978432474073, -0.788642114011)
"""Transmission zeros from the modal forces to the sensors."""

RESULTS: dict[tuple[str, str], dict[float, tuple[float, float, int, int]]] = {
    ("Table 3", NO_CARRYOVER): {
        0.0: (3.33e-7, 0.0, 0, 0),
        -3.3: (0.0283, 0.207, 2, 0),
        -6.7: (0.0462, 0.266, 1, 0),
        -10.0: (0.0933, 0.378, 6, 1),
    },
    ("Table 3", READING_1): {
        0.0: (4.7e-6, 0.003, 0, 0),
        -3.3: (0.0697, 0.338, 4, 0),
        -6.7: (0.0463, 0.268, 2, 0),
        -10.0: (0.0915, 0.378, 6, 1),
    },
    ("Table 3", READING_3): {
        0.0: (3.31e-7, 0.0, 0, 0),
        -3.3: (0.018, 0.144, 1, 0),
        -6.7: (0.0384, 0.232, 2, 1),
        -10.0: (0.0885, 0.368, 6, 1),
    },
    ("one setting", NO_CARRYOVER): {
        0.0: (0.0148, 0.157, 0, 0),
        -3.3: (0.0218, 0.191, 0, 0),
        -6.7: (0.04, 0.254, 1, 0),
        -10.0: (0.0775, 0.353, 2, 1),
    },
    ("one setting", READING_1): {
        0.0: (0.0194, 0.178, 0, 0),
        -3.3: (0.0244, 0.199, 0, 0),
        -6.7: (0.0385, 0.250, 1, 0),
        -10.0: (0.0732, 0.343, 3, 1),
    },
    ("one setting", READING_3): {
        0.0: (0.00339, 0.004, 0, 0),
        -3.3: (0.00659, 0.059, 0, 0),
        -6.7: (0.0235, 0.178, 1, 1),
        -10.0: (0.0523, 0.273, 1, 1),
    },
}
"""Without noise: MSE over all windows [N2], relative error of the output, false >= 1 N and 2 N."""

RECOVERED: dict[tuple[str, str], dict[float, tuple[float, float, float, float]]] = {
    ("Table 3", READING_1): {
        0.0: (-10.00, -4.99, 4.99, 9.97),
        -3.3: (-9.43, -2.98, 3.86, 6.36),
        -6.7: (-8.62, -3.51, 3.91, 8.82),
        -10.0: (-7.99, -2.81, 3.42, 8.24),
    },
    ("Table 3", READING_3): {
        0.0: (-10.00, -5.00, 5.00, 10.00),
        -3.3: (-9.58, -4.89, 4.52, 9.41),
        -6.7: (-9.12, -4.72, 4.44, 8.96),
        -10.0: (-8.69, -3.18, 4.16, 8.53),
    },
    ("one setting", READING_1): {
        0.0: (-9.60, -3.28, 4.14, 8.23),
        -3.3: (-9.11, -3.07, 3.87, 8.15),
        -6.7: (-8.64, -2.86, 3.60, 8.01),
        -10.0: (-8.19, -2.38, 3.35, 7.57),
    },
    ("one setting", READING_3): {
        0.0: (-10.00, -4.95, 4.98, 9.97),
        -3.3: (-9.53, -4.85, 4.69, 9.43),
        -6.7: (-9.07, -4.75, 4.40, 8.92),
        -10.0: (-8.62, -4.64, 4.13, 8.43),
    },
}
"""Outputs at the four hits of Table 2 [N]."""

ZERO_MSE = 0.613
"""MSE over all windows of the estimate that there is no force [N2]."""

RIDGE = {0.0: 0.305, -3.3: 0.311, -6.7: 0.328, -10.0: 0.352}
"""Least MSE with squares instead of the l1 norm [N2]."""

WALKS = {
    "all eight": {0.0: 0.305, -10.0: 0.349},
    "at the sensors": {0.0: 0.568, -10.0: 0.577},
    "at three of the hits, without F2": {0.0: 0.099, -10.0: 0.190},
    "at three of the hits, without F4": {0.0: 0.547, -10.0: 0.566},
}
"""Least MSE of the output with forces as random walks, by the places they are looked for [N2]."""

LAMBDA_MAX_IDENTITY = {0.0: 1.9e-6, -3.3: 8.8e-8, -6.7: 2e-10, -10.0: 2e-10}
"""Weight from which on nothing is found, if Q = eps_Q I in mass-normalised modes [1/N]."""

AMPLITUDE = {
    "Table 3": {
        0.0: (2.95e-6, 1.35e-6),
        -3.3: (0.0657, 0.0510),
        -6.7: (0.028, 0.081),
        -10.0: (0.070, 0.097),
    },
    "one setting": {
        0.0: (0.0171, 0.0113),
        -3.3: (0.0226, 0.0143),
        -6.7: (0.0355, 0.0200),
        -10.0: (0.0649, 0.0430),
    },
}
"""MSE of the output with threshold, without and with the amplitude rule, reading I [N2]."""

PLATEAU = {-3.3: 0.0144, -6.7: 0.0535, -10.0: 0.1118}
LEAST = {-3.3: 0.0089, -6.7: 0.034, -10.0: 0.070}
"""Least MSE over lam where eps_Q / eps_R is small, and where it is large [N2]."""

LARGEST_WINDOW = {
    "Table 3": {0.0: 42, -3.3: 45, -6.7: 12, -10.0: 12},
    "one setting": {0.0: 44, -3.3: 19, -6.7: 17, -10.0: 11},
}
"""Number of the window with the largest MSE, reading I."""

WINDOWS = {
    "W1": (
        {"thickness": 2.7e-3, "eps_Q": 600.0, "eps_R": 1.5e-8, "lam": 1e-3},
        {
            (5, 7): -8.20342226224991,
            (6, 4): -0.7857264767034822,
            (6, 7): 0.6294241386314253,
            (7, 0): -2.4127151615679305,
            (7, 4): 0.04675691448785147,
            (8, 0): 0.10140366011395843,
            (8, 4): -0.3955947840948297,
            (8, 7): 0.45329540320316086,
        },
    ),
    "W3": (
        {"thickness": 3.0e-3, "eps_Q": 0.075, "eps_R": 1.5e-8, "lam": 3e-4},
        {(5, 7): -9.999922206459171},
    ),
}
"""The window of samples 7 to 17 that starts from rest: setting, and (step, node) to force [N]."""
