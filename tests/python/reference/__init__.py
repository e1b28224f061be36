"""Plain NumPy reference of the estimator, written from the paper and the theory notes.

It exists so that the C++ core can be compared with something independent: slow and
obvious, one function per equation, each docstring naming the paper's equation label or
the section of the theory notes. Conventions: the attitude ``C`` takes body vectors to
the reference frame, the error is on the body side, ``C = C_hat exp(S(zeta))``, SI units
and radians, quaternions in the order (qw, qx, qy, qz), directions as (m, 3) rows.
"""
