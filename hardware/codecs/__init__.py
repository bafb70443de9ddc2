"""The codecs: pure functions between bytes and frames, one file a kind of device.

None of them is, or claims to be, the wire format of PPS DigiTacts, which is not public.
"""
