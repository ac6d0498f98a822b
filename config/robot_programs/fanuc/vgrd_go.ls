/PROG  VGRD_GO
/ATTR
OWNER           = MNEDITOR;
COMMENT         = "vgrd: go to EC";
PROG_SIZE       = 0;
CREATE          = DATE 26-11-27  TIME 08:00:00;
MODIFIED        = DATE 26-11-27  TIME 08:00:00;
FILE_NAME       = ;
VERSION         = 0;
LINE_COUNT      = 0;
MEMORY_SIZE     = 0;
PROTECT         = READ_WRITE;
TCD:  STACK_SIZE        = 0,
      TASK_PRIORITY     = 50,
      TIME_SLICE        = 0,
      BUSY_LAMP_OFF     = 0,
      ABORT_REQUEST     = 0,
      PAUSE_REQUEST     = 0;
DEFAULT_GROUP   = 1,*,*,*,*;
CONTROL_CODE    = 00000000 00000000;
/MN
   1:  !FRAGMENT, not run on hardware ;
   2:  !VGRD decides, this moves ;
   3:  !not a safety function ;
   4:  !before: R[82] point, ;
   5:  !PR[81] taught touch pose, ;
   6:  !PR[83] clear pose before it ;
   7:  UFRAME_NUM=0 ;
   8:  UTOOL_NUM=10 ;
   9:  !AGREE_MM squared ;
  10:  R[91:NEAR]=.25 ;
  11:  LBL[1:ANEW] ;
  12:  R[88:TRY]=0 ;
  13:  LBL[2:ATTEMPT] ;
  14:  R[88:TRY]=R[88:TRY]+1 ;
  15:J PR[83:CLEAR] 20% FINE ;
  16:  !first answer ;
  17:  R[89:MODE]=1 ;
  18:  R[81:ASK]=R[81:ASK]+1 ;
  19:  $WAITTMOUT=600 ;
  20:  WAIT R[83:DONE]=R[81:ASK] TIMEOUT,LBL[91] ;
  21:  IF R[84:WORD]<>0,JMP LBL[90] ;
  22:  !to the approach point ;
  23:  R[90:BEAT]=R[87:TASK] ;
  24:  $WAITTMOUT=50 ;
  25:  WAIT R[87:TASK]<>R[90:BEAT] TIMEOUT,LBL[91] ;
  26:  SKIP CONDITION F[80:VALID]=OFF ;
  27:L PR[82:APPROACH] 100mm/sec FINE Skip,LBL[10] ;
  28:  JMP LBL[92] ;
  29:  LBL[10:THERE] ;
  30:  !it stands where it was sent ;
  31:  R[84:WORD]=16 ;
  32:  PR[84:OFF]=LPOS-PR[82:APPROACH] ;
  33:  IF (PR[84,1:OFF]*PR[84,1:OFF]+PR[84,2:OFF]*PR[84,2:OFF]+PR[84,3:OFF]*PR[84,3:OFF]>R[91:NEAR]),JMP LBL[93] ;
  34:  !second answer ;
  35:  R[89:MODE]=2 ;
  36:  R[81:ASK]=R[81:ASK]+1 ;
  37:  $WAITTMOUT=600 ;
  38:  WAIT R[83:DONE]=R[81:ASK] TIMEOUT,LBL[91] ;
  39:  IF R[84:WORD]<>0,JMP LBL[90] ;
  40:  !last leg ;
  41:  R[90:BEAT]=R[87:TASK] ;
  42:  $WAITTMOUT=50 ;
  43:  WAIT R[87:TASK]<>R[90:BEAT] TIMEOUT,LBL[91] ;
  44:  SKIP CONDITION F[80:VALID]=OFF ;
  45:L PR[80:TARGET] 50mm/sec FINE Skip,LBL[20] ;
  46:  R[84:WORD]=18 ;
  47:  LBL[21:BACK] ;
  48:  !back as it came ;
  49:L PR[82:APPROACH] 50mm/sec FINE ;
  50:  JMP LBL[93] ;
  51:  LBL[20:AT POINT] ;
  52:  R[84:WORD]=16 ;
  53:  PR[84:OFF]=LPOS-PR[80:TARGET] ;
  54:  IF (PR[84,1:OFF]*PR[84,1:OFF]+PR[84,2:OFF]*PR[84,2:OFF]+PR[84,3:OFF]*PR[84,3:OFF]>R[91:NEAR]),JMP LBL[21] ;
  55:  R[84:WORD]=0 ;
  56:  JMP LBL[99] ;
  57:  LBL[90:REFUSED] ;
  58:  IF R[85:AGAIN]=0,JMP LBL[93] ;
  59:  IF R[88:TRY]>=3,JMP LBL[93] ;
  60:  WAIT    .50(sec) ;
  61:  JMP LBL[2] ;
  62:  LBL[91:LINK] ;
  63:  R[84:WORD]=1 ;
  64:  JMP LBL[93] ;
  65:  LBL[92:POLL] ;
  66:  R[84:WORD]=18 ;
  67:  LBL[93:STOP] ;
  68:  !R[84] decision, R[86] STATUS ;
  69:  MESSAGE[vgrd: see R84 and R86] ;
  70:  PAUSE ;
  71:  JMP LBL[1] ;
  72:  LBL[99:END] ;
/POS
/END
