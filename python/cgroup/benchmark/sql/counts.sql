select task, count(r.problem), coalesce(sum(coalesce(r.error, '') <> ''), 0), count(*)
from wanted left join results r using (problem, solver, threads) group by task
