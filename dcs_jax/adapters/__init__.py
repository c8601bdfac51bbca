"""dcs_jax as other people's software wants a tracker: a module each, which needs that software.

got10k   a tracker for the experiments of the package got10k (OTB, GOT-10k, VOT, ...)
trax     a process that speaks TraX, for the VOT toolkit
"""
