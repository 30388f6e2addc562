"""Records of residuals show how good a stream's sensors are; the factors of its window take their sigmas from them.

====================  =================================================================================================
module                content
====================  =================================================================================================
``residual_records``  all records of a window
``gnss_record``       positions and speeds of a receiver
``noise_record``      noise of the inertial sensor, of motion and of the wheel
``walk_record``       walks of the biases
====================  =================================================================================================
"""
