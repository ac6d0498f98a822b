"""Pure estimation: problem -> function -> result with covariance and residuals.

No I/O, no logging, no clock. Raises `vgrd.errors.CalibrationError` with the reason instead of
giving a number that the data do not determine.
"""
