"""The white noise of inertial samples shows in the samples themselves, by axis and over time.

What preintegration adds up between two keyframes is noise of low frequency, below the keyframe rate. There the
vehicle's own motion hides it. But noise that is of the samples alone is white up to the Nyquist frequency: the sensor's
own, and vibration that is sampled without a filter, whose spectrum is folded until it is flat. Motion, and vibration
that is sampled as it should be, is not: its spectrum falls somewhere below the Nyquist frequency. So

    density^2 = min over bands of S(band), where that is clearly more than what is declared,

with S the two-sided power spectral density, (rad/s)^2/Hz or (m/s^2)^2/Hz, in the three octaves below the Nyquist
frequency. S is a mean of log periodograms over a band (lines of an engine hardly count), and the median over
neighbouring blocks of the record (a shock does not count): Welch, IEEE Trans. Audio Electroacoustics 15 (1967); Wahba,
J. American Statistical Association 75 (1980), for the mean of the log of a periodogram, which is that of the density
less Euler's constant.

A line of an engine's vibration that lies near a multiple of the sampling rate is folded to near zero, where no spectrum
in motion distinguishes it from motion. But at rest all is noise: there the variance of means over half a second shows
it, and what shakes a vehicle at rest shakes it in motion, too (``noise_at_rest``).

For the same reason rests show what a sensor has at most where it is better than declared. The variance of means over
tau is theirs, and half the mean square of the difference of two means in a row, which a drift does not change: Allan,
Proc. IEEE 54 (1966). A limit of 2 sigma of it takes the place of a larger declared density where the floor shows what
motion adds: a record too short, or of too few samples a second for a floor, has what is declared.

Three more things count as noise of an interval:

- steps q of the numbers that the sensor puts out: q^2/12 for as long as a value stays, that is times dt of a signal
  that changes at each sample, and of one that rests on a value, times the time that it rests there;
- samples that are missing but not bridged, and samples at the end of the sensor's range: what was there may be as large
  as the largest deviation nearby;
- shocks: a vehicle does not change its speed within some hundredths of a second, so what a shock's samples sum up to
  along the vehicle is an error of the sensor's, in or beyond its range. Across and upwards the track moves the sensor
  as fast, but what the sensor makes of shocks is as large there.

===================  ==================================================================================================
module               content
===================  ==================================================================================================
``white_noise``      densities of the white noise of intervals
``sample_blocks``    blocks of a record: their spectra, rounding, hidden samples and shocks
``noise_at_rest``    means over half a second at rest, and the noise that these show
``noise_floor``      all of it for a record, and what it makes of the noise between any times
``vibration_power``  mean square of what is faster than the vehicle's motion
===================  ==================================================================================================
"""
