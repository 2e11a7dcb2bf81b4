"""From symbolic functions to C, CasADi and compiled libraries."""
