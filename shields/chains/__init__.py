"""Invariant sets of integrator chains in continuous time (Sections III to V of the paper).

What kernels of chains and filters are given has the same name and unit everywhere:

| parameter              | what it is                                                                        |
|------------------------|-----------------------------------------------------------------------------------|
| x1, x2, …; x           | x_1, the highest derivative, x_2, … of one state; all of them in that order       |
| u, wanted, backup      | an input, unit of dx_1/dt; the desired one; the one that is always admitted       |
| u_min, u_max           | bounds of the input, < 0 and > 0                                                  |
| bound, lower, upper    | of x_n; of every x_i, ±inf where there is none                                    |
| alpha, gamma           | α, 1/s, how fast a value may decay; γ = 1 − e^(−αΔ), what of it in a period       |
| t, t_star, period      | a time; the time of the least x_n; Δ, for which an input is held: s               |
| order                  | n                                                                                 |
| value, least           | of a set function, ≥ 0 inside; the least x_n or the least input so far            |
| p                      | a polynomial in t, the highest power first                                        |

Where a kernel takes orders 1 to 4 (``lower``, ``held_lower``, ``required``), x has four entries, zeros first.
Batches have all of it row by row: states (N, n), or flat, the others (N,).
"""
