"""What the page says between its tables."""

INTRODUCTION = """\
The authors dream of displays of millions of FLSs. How many hosts would emulate one, what stops first, and which
change of the protocol would help? The numbers below come from three sources, kept apart: *counted* in virtual time,
by the same protocol code that runs as processes; *measured* costs of the machine that ran the other pages' figures;
and *extrapolated* from both by power laws, with the assumptions at the end.

```text
python scripts/scaling_page.py --policy centralized --measure 1000 3000 10000 30000 100000
python scripts/scaling_page.py --policy roster --measure 1000 3000 10000 30000
python scripts/scaling_page.py
```

The first two count anew (the largest takes some gigabytes and the better part of an hour), the third writes this
page from `scripts/scaling/measured.json`."""

FORMATIONS = """\
A sphere's surface of F points, nearest two 2 cells apart, λ 500 ms, no loss, seed 1; counted from the first thaw to
the second, so all FLSs stand in the light from the beginning. `centralized` thaws at the very moment of one swarm:
nobody counts, so what there is to see is the merging alone. *Sent* and *delivered* are datagrams by FLS, *for many*
those sent to more than 32 FLSs, which a radio broadcasts; *largest* is how many one datagram reached, and the next
column what an FLS was delivered in the busiest tenth of a second."""

KINDS = """\
Challenges, their answers and leases go to neighbours. From the smallest display to the largest answers, ACKs and FINs
grow by less than a fifth; an FLS hears nearly twice as many challenges, and leases are renewed for as long as a
formation lasts. What grows most is what a swarm tells **all** its members. Each time one of its FLSs anchors or
localizes, SET_WAITING tells the others to wait and SET_AVAILABLE that it is over; in a swarm of half the display either
reaches half the display. FOLLOW_MERGE, which only the swarm that moves is told, grows too, but slower, for the larger
of two swarms seldom moves: the lowest Swarm-ID wins."""

OWNER = """\
With `roster`, the default, every FLS reports to its swarm's owner when it joins, and the owner thaws when it has
counted all F ([decision 0007](decisions/0007-who-knows-of-one-swarm.md)). An owner needs {ms:g} ms for a report, so
it takes {per_s:,} in a second, and a million would keep it for {million} s, if nothing else came."""

OWNER_FINDING = """\
Up to some ten thousand FLSs that costs a moment. Then reports wait, whoever is not answered reports again, the FLSs
that have nothing to do but wait probe their neighbours, and the owner is told all of it: at 30,000 the formation
takes several times as long as its merging. **At 100,000 no second thaw came within 120 s**: reports come faster than
they are taken up. `timer` has no such wall, since nobody counts; it thaws too early or too late instead ([when to
thaw](thaw-policies.md))."""

CROSSING = """\
A host gets the points of a region (the display is halved across its longest extent until there are enough parts),
and its relay sends a datagram once to each other host that has an addressee. So of what goes to neighbours only that
at the rim crosses, and it falls with the root of the FLSs on a host, as a region's rim does; of what goes to a swarm
one copy goes to each host that the swarm reaches. Copies by FLS and formation, with `centralized`:"""

HOSTS = """\
A host is {cores} cores like those that were measured, with {memory} GB of memory, busy to {busy} % in the mean:
beyond it bursts, a thaw or a large swarm's FOLLOW_MERGE, make FLSs late. The last three columns are what a host's
relay and its kernel's filters do, in wall time. *Time scale* is emulated seconds per wall second. `thaw.policy` must
not have one owner count, so this is the merging alone."""

WALLS = """\
Processors bound the hosts at the scale of real time, memory when it may take ten times as long. Two columns warn of
what comes next. A broadcast asks the filter of *every* socket of its host, so filters cost the square of the FLSs on
a host: many small hosts are better than few large ones, or a multicast group for each swarm, which asks its members'
sockets only. The relays ([how they work](cluster.md)) are nowhere near a core: what is told within a swarm crosses
once for each host, and what is told to neighbours stays at home."""

CHECK = """\
The laws from all sizes but the largest, against what was counted at the largest:"""

HELP = """\
- **Sum reports up on their way.** A swarm that merges could carry its count: the localizer's FIN tells the anchor
  how many it brings (it does so already, as an estimate), and owners need one report of each merge instead of one of
  each FLS: of the order of the number of merges of *their* swarm, not of F. It must survive lost FINs and FLSs that
  fail, so the owner would ask (ROLL_CALL) only sub-swarms whose sum does not fit.
- **Have only those wait who could disturb.** SET_WAITING and SET_AVAILABLE are four fifths of what an FLS is
  delivered at 100,000. What an anchor's SET_WAITING forbids is that another FLS of its swarm localizes meanwhile,
  and only one with a neighbour in another swarm can: the rim of the swarm. Told to the rim alone the price of a
  pairing would grow with the root of the swarm, not with the swarm.
- **A group for each swarm.** In the emulator, multicast in place of filtered broadcast: the price of a message to a
  swarm would be its members', not the host's ([decision 0005](decisions/0005-carriers.md)).
- **No thaw for all at once.** A THAW is one datagram for all and costs no more than any, but F FLSs that wake at
  once are the burst that sets the time scale. A thaw that spreads from its beginner as a wave would wake a region at
  a time."""

ASSUMPTIONS = """\
- The shape is a closed surface with even spacing, as displays of objects have it; a solid body has more neighbours
  and a larger rim between hosts (a power of 2/3 of the FLSs on a host, not 1/2).
- Nothing is lost, nobody fails. With 10 % loss at both ends a formation of 1000 takes 2.9 to 4.0 s instead of 1.6 to
  2.0 (5 seeds), and an FLS is delivered twice as much.
- Hosts' cores are as fast as those measured; a switch between hosts carries what relays send (a copy is under 200
  bytes).
- One seed. At 1000 FLSs five seeds lie between 1.6 and 2.0 s, 12.2 and 14.6 datagrams sent, 44 and 57 delivered.
- The display forms without pause. `swarmer doctor`, whose trial also rests, puts some 330 FLSs on two such cores at
  time scale 1, 165 to a core; the table has 78 to a core for 10,000.
- The time of a formation is that of its merging: flights are short, for after the first formation everyone is near
  its place.
- At a million the laws are a factor of ten beyond what was counted; the exponents are small, so an error of 0.05 in
  one is an error of 12 % there."""
