select e.id as "set", e.definition, p.dataset, p.pair, p.origin, p.protocols, p.kind, p.other, p.nuisance,
       p.level, p.matches, p.nms_radius, p.front, p.voxel, p.seed, l.label as method, s.name, s.refined,
       r.threads, h.value as epsilon, r.seconds, r.pose, r.numbers, r.skipped, r.error, r.version, r.machine,
       r.problem as "case", r.solver, l.place
from plan_sets e join plan_problems q using (entry) join plan_solvers l using (entry)
    join json_each(e.threads) t left join json_each(e.epsilons) h
    join results r on r.problem = q.problem and r.solver = l.solver and r.threads = t.value
    join problems p on p.key = q.problem join solvers s on s.key = l.solver
where e.task = ?
order by e.entry, l.place,
