"""Every number by which a model is fitted and its uncertainty stated, with its unit, its reason and its source.

Where the source says "development recordings", the number was set by hand on simulated recordings with development
seeds (tests/judge), for verdicts and not by a derivation; tests/benchmarks/test_thresholds.py shows what halving and
doubling it does. "By construction" says that another number would contradict how the thing is built.
"""

from __future__ import annotations

from typing import Final

from runtime.motion.settings import MOST_DELAY

# the skew between torque and motion ---------------------------------------------------------------------------------

HOLD: Final = (-0.25, 1.0)
"""samples; between a torque and the encoder reading beside it that a hold can explain: half a sample for the hold
alone, 0.73 to 0.78 on EMPS, and some room to either side; development and real recordings."""

COMMAND_HOLD: Final = (-0.5, 1.0)
"""samples; as HOLD, between a command that a drive's law reads and the angle beside it, on which the drive closes its
loop at once; half a sample for the hold, and up to one by which a log's row stands before or after the command's
renewal."""

NOMINAL_SKEW: Final = 0.5
"""samples; a torque that is held from one reading to the next acts half a sample later on the average; the zero-order
hold."""

SKEW_RANGE: Final = (NOMINAL_SKEW - MOST_DELAY, MOST_DELAY - NOMINAL_SKEW)
"""samples; a skew is looked for within these, for which the band's filter has room; by construction."""

LONGEST_DELAY: Final = 0.05
"""s; by so much a recorded torque is sought ahead of the motion, and by half of it behind; a field bus takes some
cycles of 1 to 10 ms to hand a command on, and a current filter of 10 to 100 Hz less."""

# what gives way ------------------------------------------------------------------------------------------------------

FINEST_STEP: Final = 0.001
"""s; the step by which a link behind a transmission is simulated from slower samples: a load that is continued in a
straight line is off by h² of its second derivative, which passes for the joint's own give. At 1 ms that is 1 % of a
stiffness whose resonance is at 24 Hz, and at 8 ms two thirds; theory of the step, and simulated drives."""

# the width of a gap -------------------------------------------------------------------------------------------------

AS_GOOD_A_FLANK: Final = 1.05
"""ratio of errors, RMS; flanks that leave no more may be the true ones: what is simulated without what lies above the
band leaves a twentieth more or less; development recordings with backlash."""

HOPELESS_FLANK: Final = 1.5
"""ratio of errors, RMS; flanks that leave more with the width that was found are as good at none; development
recordings with backlash."""

# uncertainty --------------------------------------------------------------------------------------------------------

INTERVAL_SIGMAS: Final = 1.96
"""standard deviations; the half of a 95 % interval; normal distribution."""

SCORE_BLOCK_S: Final = 1.0
"""s; residuals further apart than that are taken to be independent: long against the band's filter and the noise of
most sensors; development recordings."""

SEPARABLE: Final = 1e-4
"""ratio of singular values of the scaled Jacobian; a direction below is not told by the data; development recordings
with short motions."""

SMOOTHING_BIAS: Final = 0.5
"""standard deviations per shift of a parameter between a load that is smoothed and one that keeps the encoder's noise,
and between a command's hold as it was found and half a row; the truth lies between the two, which a 95 % interval of
that width holds; development recordings with elasticity."""

WHITENED_BIAS: Final = 1.5
"""standard deviations per shift of a parameter between plain and whitened rows; whitening takes a third to all of the
bias away; development recordings with elasticity and a disturbance on the link."""

ROTOR_STATED: Final = 0.35
"""part of a rotor's inertia in a model file; its standard deviation: a catalogue's number times a ratio squared leaves
out gear, coupling and brake, and is right to a factor of two in 95 % of cases; a choice."""

ROTOR_ASSUMED: Final = 0.5
"""part of the inertia into which a rotor's is merged; what the derived equations take for it (symbolic/model.py); the
gear that accelerates its load best makes rotor and load equal, Pasch & Seering 1984."""

# the inertia --------------------------------------------------------------------------------------------------------

HARDLY_POSITIVE: Final = 0.01
"""part of the smallest eigenvalue of D that the model file or the torques give; a fit below it stopped at the bound
of what is physical; development recordings."""

# over what a residual is structured ---------------------------------------------------------------------------------

STRUCTURE_LEAST_SHARE: Final = 0.02
"""part of the residual's variance; a signal that explains less is not named; development recordings."""

# wrong data ---------------------------------------------------------------------------------------------------------

SUSPECTED_FROM: Final = 0.05
"""part of a joint's torque; a smaller residual is that of right data: with a wrong sign, unit or joint more of inertia
and friction remains; by construction, and development recordings."""

FALLS_TO: Final = 0.7
"""part of a joint's error; to less it must fall with another sign or unit, or with two joints exchanged, before data
are suspected: with right data it rises, as inertia and friction reach their bounds; development and real recordings."""

WORK_TELLS: Final = 0.02
"""part of the product of RMS torque and RMS rate; work beyond it over a motion that returns tells a torque's sign:
springs, gravity and inertia do none, friction takes it, and a smaller part may be a load that another joint lifts; a
choice."""

SUSPECTED_RATIO: Final = 20.0
"""ratio of an inertia to the file's, or of a gear; a smaller one may be a bad guess: inertias that users guess are
wrong by factors of 2 to 5; real recordings."""

DOUBTED_RATIO: Final = 8.0
"""ratio of an inertia to the file's; from it a mistake is mentioned without a verdict, as guesses are wrong by factors
of 2 to 5; real recordings."""

EXCERPT: Final = 20_000
"""samples; enough of a motion for mistakes that concern most of the torque; a choice."""

USUAL_RATIOS: Final = (30.0, 200.0)
"""ratios of motor turns to joint turns; gears of arms whose file states 1, as URDFs do not state them: strain wave
gears have 30 to 160, and a belt may precede them; catalogues."""

USUAL_CONSTANTS: Final = (1.0, 50.0)
"""ratios of torque at the joint's output to current, N m/A; of motors that the model file does not know: 0.05 to 0.3 at
the motor, times the gear; catalogues."""

BEYOND_LIMIT: Final = 5.0
"""ratio of the largest torque to the limit in the model file; drives give two to three times the continuous torque for
seconds; catalogues."""

LITTLE_FRICTION: Final = 0.03
"""part of a joint's torque, RMS; a geared motor has more friction, and a sensor behind the gear feels less; simulated
recordings of whole arms."""

# rows that are left out -----------------------------------------------------------------------------------------------

BEAT_S: Final = 0.5
"""s; an encoder's steps beat with the samples where they do so in many rows of this time: a few waves of the beat, half
of the shortest stretches of even speed that motions have; a choice."""

LASTING_BEAT: Final = 1 / 3
"""part of the rows in BEAT_S; of speeds that only pass through, a twentieth to an eighth are near a whole number of
steps, of an even speed about half, as the beat scatters them; simulated arms."""

BEAT_WAVES: Final = 100
"""number of waves; so many of a beat in the band count; of so slow a beat nothing is heard; a choice."""

# what a board has added up -------------------------------------------------------------------------------------------

SUMS_PASSES: Final = 4
"""number of solutions; weights and residuals follow from each other, and settle at once; numerics."""

SUMS_POSTURES: Final = 400
"""number of postures over the arm's range, at which D must be positive definite;
it changes slowly with the posture; a choice."""

SPARED: Final = (0.0, 0.03, 0.1, 0.3)
"""parts of the samples, those with the largest commands, that are left out where a drive has a limit and nothing yet
tells which it cuts; the first that is as large as what the gains that follow say; a choice: a drive at its limit for
longer does not hold its motion."""

STATED_MASS: Final = 0.05
"""part of a mass, or of an inertia, by which what a model file states is off; it says how much the scale of a joint's
torque that follows from it counts beside what joints share; a choice, as simulated users' files are."""
