"""The sections of a result's page that are about the track: its quality, its curves and the places along it.

:mod:`.summary` opens the page with what can be trusted; :mod:`.exceedances` says where to go first; :mod:`.quality`
rates each 200 m; :mod:`.curve_section` lists the curves; :mod:`.known_line` says which track the run is on;
:mod:`.strip_places` names what the strip charts mark, :mod:`.background` what lies behind the map.
"""
