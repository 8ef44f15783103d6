"""What data sheets and publications give for a servo, to set fitted values beside."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

PUBLISHED: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "XL330-M288-T": {
            "torque_constant": "0.354 (e-manual: stall 0.52 Nm at 1.47 A, 5 V); 0.29 to 0.40 identified",
            "resistance": "3.4 (e-manual: 5 V / 1.47 A); 2.0 to 4.0 identified",
            "armature": "0.0018 to 0.0026 identified",
            "viscous": "0.0037 to 0.0054 identified",
            "coulomb": "0.005 to 0.013 identified",
            "stribeck": "0 to 0.01 identified",
            "stribeck_velocity": "0.12 to 0.22 identified",
            "load_motor": "0.23 identified; 0.27 to 0.37 for one load term",
            "load_external": "0.26 identified",
            "gain_divisor": "128 (e-manual); 256 observed",
            "delay": "0.005 to 0.012 identified",
        },
        "XL330-M077-T": {
            "torque_constant": "0.146 (e-manual: stall 0.215 Nm at 1.47 A, 5 V)",
            "resistance": "3.4 (e-manual: 5 V / 1.47 A)",
            "gain_divisor": "128 (e-manual); 256 observed",
        },
        "XL430-W250-T": {
            "torque_constant": "1.08 (e-manual: stall 1.4 Nm at 1.3 A, 11.1 V)",
            "resistance": "8.5 (e-manual: 11.1 V / 1.3 A)",
            "gain_divisor": "128 (e-manual)",
        },
    }
)
"""By servo model and parameter. e-manual: the ROBOTIS e-manual's page of the servo, "Specifications". Identified: the
parameter files of Rhoban/bam (Duclusaud et al. 2024), at the output shaft as in calibration/README.md."""
