"""Numbers and settings printed in Sillence (1999); no value in this module is computed."""

from __future__ import annotations

from types import MappingProxyType

GAINS_LEFT = (0.8, 0.6, 0.4, 0.2, 0.1)  # K after the failure, K_1 in the thesis
FAILED_AT_S = 4.5
ALPHA_MAX_DEG, Q_MAX_DEG_S = 6.0, 11.0  # S 5.2, "about"
Q_MAX_FITTED_DEG_S = 11.144  # not printed: with this value and the poles below all digits of Table 1 are reproduced
SNR_POLES = (-0.6737, 0.30691)  # as printed below eq (82); the poles of the plant are +0.6737 and -3.0691
SNR_DB = 37.227  # in most figures

# Table 1: (sigma_q deg/s, sigma_alpha deg, SNR dB as printed). The row of 40 dB prints 0.739 for sigma_alpha; 0.0739 gives its SNR.
TABLE_1 = (
    (0.55534, 0.03, "23.29"),
    (0.1108, 0.03, "37.227"),
    (0.0739, 0.0739, "40"),
    (0.01108, 0.03, "53.286"),
    (0.00739, 0.00739, "60"),
)

# Tables 2 (PI law) and 3 (P law): K -> eigenvalues, rad/s, as printed.
OPEN_LOOP = ("0.6737", "-3.0691", "-20.0")
TABLE_2 = MappingProxyType(
    {
        1.0: ("-14.4614+15.504j", "-14.4614-15.504j", "-1.4724", "0"),
        0.08: ("-26.6776", "-3.7210", "0.0016+0.0071j", "0.0016-0.0071j"),
    }
)
TABLE_3 = MappingProxyType(
    {
        1.0: ("-1.4724", "-14.4615+15.5040j", "-14.4615-15.5040j"),
        0.08: ("0.0032", "-3.7210", "-26.6776"),
    }
)

# Table 4, expanding horizon: K_1 -> (final K-hat, relative error in per cent, settling time s).
TABLE_4 = MappingProxyType(
    {
        0.8: (0.8413, 4.91, 0.82),
        0.6: (0.6469, 7.25, 1.93),
        0.4: (0.4306, 7.11, 2.71),
        0.2: (0.2116, 5.48, 1.83),
        0.1: (0.0996, 0.40, 1.51),
    }
)
# Table 5, moving window of 30 samples: K_1 -> (entry into 20 %, s, raw and smoothed).
TABLE_5 = MappingProxyType(
    {0.8: (0.02, 0.09), 0.6: (0.08, 0.17), 0.4: (0.12, 0.26), 0.2: (0.19, 0.44), 0.1: (0.23, 0.51)}
)
